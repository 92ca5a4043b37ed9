//! Dates of the proleptic Gregorian calendar.

/// Seconds since 1970-01-01T00:00:00 UTC; `None` for a date or time of day that does not exist.
pub(crate) fn seconds(year: i64, month: u8, day: u8, hour: u8, minute: u8, second: u8) -> Option<i64> {
    if hour > 23 || minute > 59 || second > 59 || day == 0 || day > days_in_month(year, month)? {
        return None;
    }
    let days = days_from_civil(year, i64::from(month), i64::from(day));
    Some(((days * 24 + i64::from(hour)) * 60 + i64::from(minute)) * 60 + i64::from(second))
}

/// Year, month, day, hour, minute and second of a number of seconds since 1970.
pub(crate) fn civil(seconds: i64) -> (i64, u8, u8, u8, u8, u8) {
    let (days, rest) = (seconds.div_euclid(86_400) + DAYS_TO_1970, seconds.rem_euclid(86_400));
    // The inverse of `days_from_civil`, in the same years that begin in March.
    let (era, day_of_era) = (days.div_euclid(DAYS_OF_ERA), days.rem_euclid(DAYS_OF_ERA));
    let leap_days = day_of_era / 1_460 - day_of_era / 36_524 + day_of_era / (DAYS_OF_ERA - 1);
    let year_of_era = (day_of_era - leap_days) / 365;
    let day_of_year = day_of_era - (year_of_era * 365 + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12 + 1;
    let year = era * 400 + year_of_era + i64::from(month <= 2);
    (year, month as u8, day as u8, (rest / 3600) as u8, (rest / 60 % 60) as u8, (rest % 60) as u8)
}

/// A date and time as the name of a file or folder, for example `2026-11-21T14-00-15Z`.
pub fn name(seconds: i64) -> String {
    let (year, month, day, hour, minute, second) = civil(seconds);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}-{minute:02}-{second:02}Z")
}

/// Days of 400 years, after which the calendar repeats.
const DAYS_OF_ERA: i64 = 146_097;
/// Days from 1 March of the year 0 to 1970-01-01.
const DAYS_TO_1970: i64 = 719_468;

fn days_in_month(year: i64, month: u8) -> Option<u8> {
    Some(match month {
        1 | 3 | 5 | 7 | 8 | 10 | 12 => 31,
        4 | 6 | 9 | 11 => 30,
        2 if year % 4 == 0 && (year % 100 != 0 || year % 400 == 0) => 29,
        2 => 28,
        _ => return None,
    })
}

/// Days since 1970-01-01, counted in years that begin in March, so that the leap day is the last of a year.
fn days_from_civil(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let era = year.div_euclid(400);
    let year_of_era = year.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    era * DAYS_OF_ERA + day_of_era - DAYS_TO_1970
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_dates_have_their_seconds_and_come_back() {
        for (date, expected) in [
            ((1677, 9, 21, 0, 12, 43), -9_223_372_037),
            ((1968, 12, 31, 23, 59, 59), -31_536_001),
            ((1970, 1, 1, 0, 0, 0), 0),
            ((2000, 1, 1, 0, 0, 0), 946_684_800),
            ((2024, 2, 29, 23, 59, 59), 1_709_251_199),
            ((2026, 11, 21, 14, 0, 15), 1_795_269_615),
            ((2099, 12, 31, 23, 59, 59), 4_102_444_799),
        ] {
            let (year, month, day, hour, minute, second) = date;
            assert_eq!(seconds(year, month, day, hour, minute, second), Some(expected));
            assert_eq!(civil(expected), date);
        }
    }

    #[test]
    fn every_day_of_four_centuries_is_the_day_after_the_one_before() {
        let mut last = civil(-86_400 * 134_774); // 1601-01-01
        assert_eq!(last, (1601, 1, 1, 0, 0, 0));
        for day in -134_773..=11_323 {
            let (year, month, day_of_month, ..) = civil(day * 86_400);
            let expected = match last {
                (year, month, day, ..) if days_in_month(year, month) > Some(day) => (year, month, day + 1),
                (year, 12, ..) => (year + 1, 1, 1),
                (year, month, ..) => (year, month + 1, 1),
            };
            assert_eq!((year, month, day_of_month), expected);
            assert_eq!(seconds(year, month, day_of_month, 0, 0, 0), Some(day * 86_400));
            last = (year, month, day_of_month, 0, 0, 0);
        }
        assert_eq!(last, (2001, 1, 1, 0, 0, 0));
    }

    #[test]
    fn dates_that_do_not_exist_are_refused() {
        for (year, month, day, hour) in [
            (2023, 2, 29, 0),
            (2024, 13, 1, 0),
            (2024, 0, 1, 0),
            (2024, 4, 31, 0),
            (2024, 4, 0, 0),
            (2024, 1, 1, 24),
        ] {
            assert_eq!(seconds(year, month, day, hour, 0, 0), None);
        }
    }
}
