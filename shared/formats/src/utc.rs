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
    let (days, rest) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    let mut year = 1970 + days.div_euclid(366);
    while days_from_civil(year + 1, 1, 1) <= days {
        year += 1;
    }
    let mut day_of_year = days - days_from_civil(year, 1, 1);
    let mut month = 1;
    while let Some(length) = days_in_month(year, month).map(i64::from).filter(|length| day_of_year >= *length)
    {
        day_of_year -= length;
        month += 1;
    }
    (year, month, day_of_year as u8 + 1, (rest / 3600) as u8, (rest / 60 % 60) as u8, (rest % 60) as u8)
}

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
    era * 146_097 + day_of_era - 719_468
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_dates_have_their_seconds_and_come_back() {
        for (date, expected) in [
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
