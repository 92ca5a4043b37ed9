//! A recording scan by scan: each waits for a line on standard input.

use std::io::{BufRead as _, Write as _};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::time::Duration;

use evac_frames::{ImuSample, ScanHeader};
use evac_ports::Bus;

use crate::pace::Next;
use crate::{Reporter, RunError, SensorEvent};

/// Longest sleep, after which SIGTERM is looked for.
const NAP: Duration = Duration::from_millis(100);
const HELP: &str =
    "Enter: the next scan; a number: so many; end of input (Ctrl-D): the rest without stopping";

/// Lets a scan go for each line, and the IMU samples that belong to it: those before it, and the first from after its end, so that
/// whoever deskews it need not wait.
#[derive(Debug)]
pub(crate) struct Steps {
    lines: Receiver<String>,
    /// Scans that may go.
    granted: u64,
    /// End of the newest scan that has gone.
    end_ns: i64,
    /// An IMU sample from after it has gone too.
    covered: bool,
    /// Start of the first scan.
    first_ns: Option<i64>,
    /// IMU samples since the scan before.
    samples: u64,
}

impl Steps {
    /// Listens to standard input from now on.
    pub(crate) fn start() -> Self {
        let (sender, lines) = sync_channel(16);
        // Without the thread no line will come, which is the end of input.
        let listen = move || {
            let mut input = std::io::stdin().lock();
            let mut line = String::new();
            while matches!(input.read_line(&mut line), Ok(1..))
                && sender.send(std::mem::take(&mut line)).is_ok()
            {}
        };
        drop(std::thread::Builder::new().name("steps".to_owned()).spawn(listen));
        eprintln!("{HELP}");
        Self { lines, granted: 0, end_ns: i64::MIN, covered: false, first_ns: None, samples: 0 }
    }

    /// Waits until `event` may go; whether it had to wait.
    pub(crate) fn wait(
        &mut self,
        event: &SensorEvent,
        bus: &Bus,
        reporter: &mut Reporter,
    ) -> Result<(Next, bool), RunError> {
        let mut waited = false;
        while self.must_wait(event) {
            waited = true;
            if bus.stop_requested() {
                return Ok((Next::Stop, waited));
            }
            reporter.report_if_due()?;
            match self.lines.recv_timeout(NAP) {
                Ok(line) => match scans_of(&line) {
                    Some(scans) => self.granted = scans,
                    None => eprintln!("'{}' is no number of scans; {HELP}", line.trim()),
                },
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => self.granted = u64::MAX,
            }
        }
        Ok((Next::Go, waited))
    }

    fn must_wait(&self, event: &SensorEvent) -> bool {
        self.granted == 0 && (self.covered || matches!(event, SensorEvent::Scan(_)))
    }

    pub(crate) fn sample_went(&mut self, sample: &ImuSample) {
        self.samples += 1;
        self.covered |= self.first_ns.is_some() && sample.stamp_ns >= self.end_ns;
    }

    /// Says what has gone.
    pub(crate) fn scan_went(&mut self, header: &ScanHeader) {
        // The rest is not counted down.
        self.granted -= u64::from(self.granted != u64::MAX);
        let frame = &header.frame;
        let first_ns = *self.first_ns.get_or_insert(frame.start_ns);
        let seconds = |ns: i64| ns.saturating_sub(first_ns) as f64 * 1e-9;
        // Nobody may be reading any more.
        let _ = writeln!(
            std::io::stdout(),
            "scan {}: {:.3} s to {:.3} s, {} points, {} of them without return, {} IMU samples since the one before",
            frame.seq,
            seconds(frame.start_ns),
            seconds(frame.end_ns),
            header.points,
            header.no_return,
            self.samples
        );
        (self.end_ns, self.covered, self.samples) = (frame.end_ns, false, 0);
    }
}

/// How many scans a line lets go.
fn scans_of(line: &str) -> Option<u64> {
    match line.trim() {
        "" => Some(1),
        number => number.parse().ok().filter(|scans| *scans > 0),
    }
}

#[cfg(test)]
mod tests {
    use evac_frames::FrameHeader;

    use super::*;

    fn steps() -> Steps {
        let (_, lines) = sync_channel(1);
        Steps { lines, granted: 0, end_ns: i64::MIN, covered: false, first_ns: None, samples: 0 }
    }

    fn imu(stamp_ns: i64) -> ImuSample {
        ImuSample { stamp_ns, ..ImuSample::default() }
    }

    #[test]
    fn a_line_lets_a_scan_go_with_the_samples_before_it_and_the_first_after_its_end() {
        let mut steps = steps();
        let frame = FrameHeader { start_ns: 0, end_ns: 100, ..FrameHeader::default() };
        let scan = ScanHeader { frame, ..ScanHeader::default() };
        for stamp in [-20, 90] {
            assert!(!steps.must_wait(&SensorEvent::Imu(imu(stamp))));
            steps.sample_went(&imu(stamp));
        }
        assert!(steps.must_wait(&SensorEvent::Scan(scan)));
        steps.granted = 1;
        assert!(!steps.must_wait(&SensorEvent::Scan(scan)));
        steps.scan_went(&scan);
        assert!(!steps.must_wait(&SensorEvent::Imu(imu(110))));
        steps.sample_went(&imu(110));
        assert!(steps.must_wait(&SensorEvent::Imu(imu(120))));
    }

    #[test]
    fn lines_are_one_scan_or_a_number_of_them() {
        assert_eq!(
            [scans_of("\n"), scans_of(" 12\n"), scans_of("0"), scans_of("-1"), scans_of("go")],
            [Some(1), Some(12), None, None, None]
        );
    }
}
