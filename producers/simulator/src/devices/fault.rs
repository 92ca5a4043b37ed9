//! What goes wrong during a walk, and when.

use std::fmt::{Display, Formatter};
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::imu_thread::ImuFaults;
use super::livox;

/// A fault: `KIND[=VALUE][@START[+SECONDS]]`, times from the walk's beginning.
///
/// ```
/// use evac_simulator::devices::Fault;
///
/// assert_eq!("cable@20+5".parse::<Fault>()?.to_string(), "cable@20+5");
/// assert!("lost=2".parse::<Fault>().unwrap_err().contains("0 to 1"));
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Fault {
    kind: Kind,
    value: f64,
    start_s: f64,
    /// Infinite for one that stays.
    lasts_s: f64,
}

/// For people: every kind with its value.
pub const FAULTS_HELP: &str = "KIND[=VALUE][@START[+SECONDS]], times in seconds from the walk's beginning:\n  \
    lost=SHARE           share of the LiDAR's packets that get lost; 0.01 is one in a hundred\n  \
    repeated=SHARE       ... that come twice\n  \
    late=SHARE           ... that the next three overtake\n  \
    corrupt=SHARE        ... with a changed byte, or cut\n  \
    clock-step=MS@START  the LiDAR's clock is set forward (negative: back) and stays so\n  \
    cable@START+S        the LiDAR's cable is out\n  \
    deaf@START+S         the LiDAR hears no heartbeats and questions\n  \
    power@START+S        the LiDAR has no power, and boots afterwards\n  \
    imu-cable@START+S    the WT901C is unplugged (and forgets what it had not saved)\n  \
    imu-silent@START+S   the WT901C sends nothing\n  \
    imu-lost=SHARE       share of its bytes that get lost\n  \
    imu-corrupt=SHARE    ... with a flipped bit\n  \
    imu-garbage=BYTES    bytes of rubbish before each of its samples\n  \
    imu-clock-step=MS@START";

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Lost,
    Repeated,
    Late,
    Corrupt,
    ClockStep,
    Cable,
    Deaf,
    Power,
    ImuCable,
    ImuSilent,
    ImuLost,
    ImuCorrupt,
    ImuGarbage,
    ImuClockStep,
}

/// What stands behind `=`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Takes {
    Nothing,
    Share,
    Milliseconds,
    Bytes,
}

const KINDS: [(Kind, &str, Takes); 14] = [
    (Kind::Lost, "lost", Takes::Share),
    (Kind::Repeated, "repeated", Takes::Share),
    (Kind::Late, "late", Takes::Share),
    (Kind::Corrupt, "corrupt", Takes::Share),
    (Kind::ClockStep, "clock-step", Takes::Milliseconds),
    (Kind::Cable, "cable", Takes::Nothing),
    (Kind::Deaf, "deaf", Takes::Nothing),
    (Kind::Power, "power", Takes::Nothing),
    (Kind::ImuCable, "imu-cable", Takes::Nothing),
    (Kind::ImuSilent, "imu-silent", Takes::Nothing),
    (Kind::ImuLost, "imu-lost", Takes::Share),
    (Kind::ImuCorrupt, "imu-corrupt", Takes::Share),
    (Kind::ImuGarbage, "imu-garbage", Takes::Bytes),
    (Kind::ImuClockStep, "imu-clock-step", Takes::Milliseconds),
];

/// Everything that is wrong at a moment.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Wrong {
    pub(super) lidar: livox::Faults,
    /// Until when the LiDAR has no power, seconds.
    pub(super) lidar_off_until_s: Option<f64>,
    pub(super) imu: ImuFaults,
}

impl Wrong {
    /// What is wrong `time_s` after the walk's beginning.
    pub(super) fn at(faults: &[Fault], time_s: f64) -> Self {
        let mut wrong = Self::default();
        for fault in faults.iter().filter(|fault| fault.is_on(time_s)) {
            let (value, lidar, imu) = (fault.value, &mut wrong.lidar, &mut wrong.imu);
            match fault.kind {
                Kind::Lost => lidar.lost_share = value,
                Kind::Repeated => lidar.repeated_share = value,
                Kind::Late => lidar.late_share = value,
                Kind::Corrupt => lidar.corrupt_share = value,
                Kind::ClockStep => lidar.clock_step_ms += value,
                Kind::Cable => lidar.cable_out = true,
                Kind::Deaf => lidar.deaf = true,
                Kind::Power => wrong.lidar_off_until_s = Some(fault.start_s + fault.lasts_s),
                Kind::ImuCable => imu.unplugged = true,
                Kind::ImuSilent => imu.line.silent = true,
                Kind::ImuLost => imu.line.drop_share = value,
                Kind::ImuCorrupt => imu.line.corrupt_share = value,
                Kind::ImuGarbage => imu.line.garbage_bytes = value as usize,
                Kind::ImuClockStep => imu.clock_step_ms += value,
            }
        }
        wrong
    }
}

impl Fault {
    /// Whether it is on `time_s` after the walk's beginning.
    pub(super) fn is_on(&self, time_s: f64) -> bool {
        (self.start_s..self.start_s + self.lasts_s).contains(&time_s)
    }

    /// Whether it is one of the WT901C.
    pub(super) fn is_of_imu(&self) -> bool {
        self.name().starts_with("imu-")
    }

    fn name(&self) -> &'static str {
        KINDS.iter().find(|(kind, ..)| *kind == self.kind).map_or("", |(_, name, _)| name)
    }

    fn check(&self, takes: Takes) -> Result<(), &'static str> {
        let value_is_right = match takes {
            Takes::Nothing => true,
            Takes::Share if !(0.0..=1.0).contains(&self.value) => return Err("its share must lie in 0 to 1"),
            Takes::Milliseconds if !(-1e9..=1e9).contains(&self.value) => {
                return Err("a step is at most 1e9 ms");
            }
            Takes::Bytes if !(0.0..=1000.0).contains(&self.value) => return Err("at most 1000 bytes"),
            _ => true,
        };
        let stays = matches!(self.kind, Kind::ClockStep | Kind::ImuClockStep);
        if stays && self.lasts_s.is_finite() {
            return Err("a step stays: leave +SECONDS out");
        }
        if takes == Takes::Nothing && !self.lasts_s.is_finite() {
            return Err("say how long with @START+SECONDS");
        }
        let times_are_right = (0.0..1e6).contains(&self.start_s) && self.lasts_s > 0.0;
        if value_is_right && times_are_right { Ok(()) } else { Err("times are seconds, 0 to 1e6") }
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let bad = |why: &str| format!("fault '{text}': {why}; see `evac demo --help`");
        let number = |text: &str| text.parse::<f64>().map_err(|_| bad(&format!("'{text}' is no number")));
        let (what, when) = text.split_once('@').map_or((text, None), |(what, when)| (what, Some(when)));
        let (name, value) = what.split_once('=').map_or((what, None), |(name, value)| (name, Some(value)));
        let (kind, _, takes) =
            *KINDS.iter().find(|(_, known, _)| *known == name).ok_or_else(|| bad("there is no such kind"))?;
        if value.is_some() == (takes == Takes::Nothing) {
            return Err(bad(if value.is_some() { "it takes no value" } else { "it needs =VALUE" }));
        }
        let (start, lasts) = match when {
            None => (None, None),
            Some(when) => match when.split_once('+') {
                Some((start, lasts)) => (Some(start), Some(lasts)),
                None => (Some(when), None),
            },
        };
        let fault = Self {
            kind,
            value: value.map_or(Ok(0.0), number)?,
            start_s: start.map_or(Ok(0.0), number)?,
            lasts_s: lasts.map_or(Ok(f64::INFINITY), number)?,
        };
        fault.check(takes).map_err(bad)?;
        Ok(fault)
    }
}

impl Display for Fault {
    fn fmt(&self, formatter: &mut Formatter<'_>) -> std::fmt::Result {
        let takes = KINDS.iter().find(|(kind, ..)| *kind == self.kind).map(|(_, _, takes)| *takes);
        write!(formatter, "{}", self.name())?;
        if takes != Some(Takes::Nothing) {
            write!(formatter, "={}", self.value)?;
        }
        if self.start_s > 0.0 || self.lasts_s.is_finite() {
            write!(formatter, "@{}", self.start_s)?;
        }
        if self.lasts_s.is_finite() { write!(formatter, "+{}", self.lasts_s) } else { Ok(()) }
    }
}

impl TryFrom<String> for Fault {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Fault> for String {
    fn from(fault: Fault) -> Self {
        fault.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn faults(texts: &[&str]) -> Vec<Fault> {
        texts.iter().map(|text| text.parse().unwrap()).collect()
    }

    #[test]
    fn every_kind_is_read_written_and_in_the_help() {
        for (kind, name, takes) in KINDS {
            let text = match takes {
                Takes::Nothing => format!("{name}@20+5.5"),
                Takes::Milliseconds => format!("{name}=-50@12"),
                Takes::Share | Takes::Bytes => format!("{name}=1@3+4"),
            };
            let fault: Fault = text.parse().unwrap();
            assert_eq!((fault.kind, fault.to_string()), (kind, text));
            assert!(FAULTS_HELP.contains(name), "{name}");
        }
        assert_eq!(faults(&["lost=0.01"])[0].to_string(), "lost=0.01");
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_the_reason() {
        for (text, why) in [
            ("lots", "no such kind"),
            ("lost", "needs =VALUE"),
            ("lost=1.5", "0 to 1"),
            ("lost=nan", "0 to 1"),
            ("lost=few", "no number"),
            ("cable=1@2+3", "takes no value"),
            ("cable", "how long"),
            ("cable@2", "how long"),
            ("power@2+0", "times are seconds"),
            ("power@-1+2", "times are seconds"),
            ("clock-step=5@2+3", "stays"),
            ("imu-garbage=1e9", "1000 bytes"),
        ] {
            let refusal = text.parse::<Fault>().unwrap_err();
            assert!(refusal.contains(why), "{text}: {refusal}");
        }
    }

    #[test]
    fn faults_are_on_in_their_time_and_steps_add_up() {
        let list = faults(&[
            "lost=0.1@1+2",
            "clock-step=500@2",
            "clock-step=-20@4",
            "power@5+3",
            "imu-cable@1.5+1",
            "imu-garbage=7",
        ]);
        let at = |time_s| Wrong::at(&list, time_s);
        assert_eq!(at(0.5).lidar, livox::Faults::default());
        assert_eq!((at(0.5).imu.line.garbage_bytes, at(0.5).imu.unplugged), (7, false));
        let wrong = at(2.0);
        assert_eq!((wrong.lidar.lost_share, wrong.lidar.clock_step_ms), (0.1, 500.0));
        assert!(wrong.imu.unplugged && wrong.lidar_off_until_s.is_none());
        let wrong = at(6.0);
        assert_eq!((wrong.lidar.lost_share, wrong.lidar.clock_step_ms), (0.0, 480.0));
        assert_eq!(wrong.lidar_off_until_s, Some(8.0));
        assert_eq!(at(8.0).lidar_off_until_s, None);
    }
}
