//! How a device fares, for `evac status` and summary.json.

use evac_formats::{livox_sdk1, livox_sdk2};
use evac_frames::{DeviceHealth, DeviceKind, Health, NO_DEVICE_STATE, NO_TEMPERATURE};
use serde_json::{Map, Value, json};

/// Everything that is known of the device of a driver; null for other stages.
pub(crate) fn device_json(health: &Health) -> Value {
    let device = &health.device;
    let Some(kind) = kind_of(device) else { return Value::Null };
    let flags: Map<String, Value> =
        flags(device).into_iter().map(|(name, word)| (name.to_owned(), Value::from(word))).collect();
    json!({
        "kind": kind,
        "state": state_word(device),
        "status": device.status,
        "flags": flags,
        "codes": device.codes.iter().filter(|code| **code != 0).collect::<Vec<_>>(),
        "temperature_c": temperature_c(device),
        "sessions": device.sessions,
        "clock_steps": device.clock_steps,
        "packets": {
            "used": device.used,
            "lost": device.lost,
            "late": device.late,
            "foreign": device.foreign,
            "corrupt": device.corrupt,
            "untimed": device.untimed,
            "imu": device.imu,
        },
    })
}

/// The same in a line for people; flags only where something is not as it should be.
pub(crate) fn device_line(health: &Health) -> Option<String> {
    let device = &health.device;
    let is_imu = device.kind == DeviceKind::Wt901c as u32;
    let mut line = kind_of(device)?.to_owned();
    if let Some(state) = state_word(device) {
        line += &format!(" {state}");
    }
    if let Some(temperature) = temperature_c(device) {
        line += &format!(", {temperature:.1} C");
    }
    let fine = ["ok", "none", "no", "off", "absent"];
    for (name, word) in flags(device).into_iter().filter(|(_, word)| !fine.contains(word)) {
        line += &format!(", {name} {word}");
    }
    for code in device.codes.iter().filter(|code| **code != 0) {
        line += &format!(", code {code:#010x}");
    }
    line += &format!("; sessions {}, clock steps {}", device.sessions, device.clock_steps);
    line += &match is_imu {
        true => format!(
            "; samples {}, lost {}, late {}, untimed {}; bytes of rubbish {}",
            device.used, device.lost, device.late, device.untimed, device.corrupt
        ),
        false => format!(
            "; packets {}, lost {}, late {}, foreign {}, corrupt {}, untimed {}; IMU {}",
            device.used, device.lost, device.late, device.foreign, device.corrupt, device.untimed, device.imu
        ),
    };
    Some(line)
}

fn kind_of(device: &DeviceHealth) -> Option<&'static str> {
    let kinds = [
        (DeviceKind::LivoxSdk1, "livox_sdk1"),
        (DeviceKind::LivoxSdk2, "livox_sdk2"),
        (DeviceKind::Wt901c, "wt901c"),
    ];
    kinds.into_iter().find(|(kind, _)| *kind as u32 == device.kind).map(|(_, name)| name)
}

/// What the device does; `None` before it has said so.
fn state_word(device: &DeviceHealth) -> Option<String> {
    if device.state == NO_DEVICE_STATE {
        return None;
    }
    let state = u8::try_from(device.state).ok();
    let word = if device.kind == DeviceKind::LivoxSdk1 as u32 {
        use livox_sdk1::WorkState;
        state.and_then(WorkState::from_wire).map(|state| match state {
            WorkState::Initialising => "initialising",
            WorkState::Normal => "normal",
            WorkState::PowerSaving => "power saving",
            WorkState::Standby => "standby",
            WorkState::Error => "error",
        })
    } else {
        use livox_sdk2::WorkState;
        state.and_then(WorkState::from_wire).map(|state| match state {
            WorkState::Sampling => "sampling",
            WorkState::Idle => "idle",
            WorkState::Sleep => "sleep",
            WorkState::Error => "error",
            WorkState::SelfCheck => "self-check",
            WorkState::MotorStart => "motor start",
            WorkState::MotorStop => "motor stop",
            WorkState::Upgrade => "upgrade",
            WorkState::Ready => "ready",
        })
    };
    Some(word.map_or_else(|| format!("state {}", device.state), str::to_owned))
}

fn temperature_c(device: &DeviceHealth) -> Option<f64> {
    (device.temperature_centi != NO_TEMPERATURE).then(|| f64::from(device.temperature_centi) * 0.01)
}

fn flags(device: &DeviceHealth) -> Vec<(&'static str, &'static str)> {
    if device.kind == DeviceKind::LivoxSdk1 as u32 {
        livox_sdk1::Status(device.status).flags().to_vec()
    } else if device.kind == DeviceKind::LivoxSdk2 as u32 {
        livox_sdk2::Diagnostics(device.status as u16).flags().to_vec()
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn health(kind: DeviceKind, state: u32, status: u32) -> Health {
        let device = DeviceHealth {
            kind: kind as u32,
            state,
            status,
            used: 1000,
            lost: 3,
            late: 2,
            foreign: 50,
            corrupt: 7,
            sessions: 2,
            temperature_centi: NO_TEMPERATURE,
            ..DeviceHealth::default()
        };
        Health { device, ..Health::default() }
    }

    #[test]
    fn a_device_s_own_flags_and_its_driver_s_counts_are_in_the_json_and_in_the_line() {
        // Temperature extreme, voltage high, PTP followed, system warning.
        let health = health(DeviceKind::LivoxSdk1, 1, 2 | 1 << 2 | 1 << 14 | 1 << 30);
        let json = device_json(&health);
        assert_eq!((&json["kind"], &json["state"]), (&json!("livox_sdk1"), &json!("normal")));
        assert_eq!(json["flags"]["temperature"], "extreme");
        assert_eq!((&json["flags"]["voltage"], &json["flags"]["motor"]), (&json!("high"), &json!("ok")));
        assert_eq!(json["packets"]["foreign"], 50);
        assert_eq!(json["temperature_c"], Value::Null);
        let line = device_line(&health).unwrap();
        for part in ["normal", "temperature extreme", "voltage high", "time_sync ptp", "lost 3", "corrupt 7"]
        {
            assert!(line.contains(part), "no '{part}' in {line}");
        }
        assert!(!line.contains("motor"), "{line}");
    }

    #[test]
    fn a_second_protocol_s_diagnostics_codes_and_temperature_are_in_words() {
        let mut health = health(DeviceKind::LivoxSdk2, 5, 0x20);
        health.device.temperature_centi = 4150;
        health.device.codes[1] = 0x0102_0304;
        let json = device_json(&health);
        assert_eq!((&json["state"], &json["flags"]["scanner"]), (&json!("self-check"), &json!("error")));
        assert_eq!((&json["temperature_c"], &json["codes"]), (&json!(41.5), &json!([0x0102_0304])));
        let line = device_line(&health).unwrap();
        assert!(line.contains("41.5 C, scanner error, code 0x01020304"), "{line}");
        health.device.state = 77;
        assert!(device_line(&health).unwrap().contains("state 77"));
    }

    #[test]
    fn other_stages_have_no_device() {
        assert_eq!(device_json(&Health::default()), Value::Null);
        assert_eq!(device_line(&Health::default()), None);
    }
}
