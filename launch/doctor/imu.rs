//! Whether a WT901C answers on a port, and at which speed.

use evac_imu::Config;

use super::finding::Finding;
use super::serial;

const TOPIC: &str = "imu";

/// The port, and what is at its other end. The module is listened to and asked, not set.
pub(crate) fn look(stage: &str, config: Config) -> Vec<Finding> {
    let port = config.port.clone();
    let mut findings = Vec::new();
    if config.usb_id.is_none() {
        match std::fs::metadata(&port) {
            Ok(_) => findings.extend(serial::permission(&port)),
            Err(cause) => {
                let remedy = "plug it in; name its port (`ls /dev/serial/by-id`) or install launch/udev/99-evac-imu.rules";
                return vec![Finding::fault(TOPIC, format!("{stage}: {}: {cause}", port.display()), remedy)];
            }
        }
    }
    let (wanted_baud, wanted_hz, configures) = (config.baud, config.rate_hz, config.configure);
    findings.push(match evac_imu::probe(config) {
        Ok(found) if found.baud == wanted_baud => {
            Finding::good(TOPIC, format!("{stage}: WT901C at {} baud", found.baud))
        }
        Ok(found) if configures => Finding::good(
            TOPIC,
            format!(
                "{stage}: WT901C at {} baud; the driver will set {wanted_baud} and {wanted_hz} Hz",
                found.baud
            ),
        ),
        Ok(found) => Finding::advice(
            TOPIC,
            format!("{stage}: WT901C at {} baud, not {wanted_baud}", found.baud),
            "set configure = true once, or baud to what it has",
        ),
        Err(cause) => {
            let remedy = "check power and wires (TX to RX), and protocol = \"modbus\" for an RS485 module";
            Finding::fault(TOPIC, format!("{stage}: {cause}"), remedy)
        }
    });
    findings
}
