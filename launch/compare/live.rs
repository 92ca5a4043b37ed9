//! The instance that leads beside its shadow.

use std::io::Write as _;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use evac_config::Pipeline;
use evac_frames::{FrameHeader, Health, StageState};
use evac_ports::services::{MapUpdate, OdometryPose, ScanDeskewed};
use evac_ports::{Bus, Domain, FrameSubscriber, Listener, PortError, RecordSubscriber, Wake, wait_on};
use indicatif::ProgressBar;

use super::cli::CompareArgs;
use super::deviation::{MAPS, Maps, POSES, SCANS, of_poses, of_scans};
use super::pairs::{Pairs, Port};
use super::report::{Comparison, Measures, Row, Side};
use super::usage;
use crate::cpu::cpu_s;
use crate::error::LaunchError;
use crate::health_board::{HealthBoard, leads};
use crate::progress;
use crate::registry::{ODOMETRIES, kind};
use crate::status::nothing_runs;

/// Every stage reports once a second.
const PATIENCE: Duration = Duration::from_millis(2500);
/// Time between two tables, on a terminal and elsewhere.
const REDRAW: Duration = Duration::from_secs(1);
const LINE: Duration = Duration::from_secs(5);

pub(super) fn compare(args: &CompareArgs) -> Result<Comparison, LaunchError> {
    let domain = Domain::new(args.domain.as_deref().unwrap_or(Domain::DEFAULT))?;
    domain.holder().ok_or_else(|| nothing_runs(&domain))?;
    let bus = Bus::join(&domain, "compare")?;
    let (mut board, listener) = HealthBoard::open(&bus)?;
    let name = args.what.to_string_lossy();
    let found = find(&domain, &mut board, &listener, &name)?;
    // Only where there is a shadow: joining its domain would begin one.
    let shadows = Bus::join(&domain.of_shadows()?, "compare")?;
    let writes = kind(&found.kind)?.writes.first().copied().unwrap_or_default();
    let mut maps = Maps::default();
    let watch = Watch { args, domain: &domain, bus: &bus, board, health: listener, found };
    match writes {
        "odometry/pose" => {
            watch.run::<RecordSubscriber<OdometryPose>>([&bus, &shadows], POSES, |a, b| Some(of_poses(a, b)))
        }
        "scan/deskewed" => watch.run::<FrameSubscriber<ScanDeskewed>>([&bus, &shadows], SCANS, |a, b| {
            of_scans(a.items(), b.items())
        }),
        "map/update" => watch.run::<FrameSubscriber<MapUpdate>>([&bus, &shadows], MAPS, |a, b| {
            Some(maps.of_updates(a.items(), b.items()))
        }),
        other => Err(usage(format!("what is written on '{other}' cannot be compared"))),
    }
}

/// A stage with a shadow.
struct Found {
    name: String,
    /// Of the shadow.
    kind: String,
    shadow: (u32, u32),
}

fn find(
    domain: &Domain,
    board: &mut HealthBoard,
    health: &Listener,
    name: &str,
) -> Result<Found, LaunchError> {
    let until = Instant::now() + PATIENCE;
    let found = wait_on(std::slice::from_ref(health), |wake| {
        if let Err(cause) = board.take_in() {
            return ControlFlow::Break(Err(cause));
        }
        let found = shadows(domain, board).into_iter().find(|found| {
            found.name == name || name == "odometry" && ODOMETRIES.contains(&found.kind.as_str())
        });
        match until.checked_duration_since(Instant::now()) {
            _ if found.is_some() || wake == Wake::Stop => ControlFlow::Break(Ok(found)),
            Some(left) if !left.is_zero() => ControlFlow::Continue(left),
            _ => ControlFlow::Break(Ok(None)),
        }
    })??;
    found.ok_or_else(|| {
        LaunchError::Path(format!(
            "'{name}' has no shadow in domain '{}'; start one with evac shadow {name} --run EXECUTABLE",
            domain.name()
        ))
    })
}

fn shadows(domain: &Domain, board: &HealthBoard) -> Vec<Found> {
    let is_shadow = |health: &&Health| health.state == StageState::Shadow as u32;
    let names = board.all().map(|(name, _)| name.to_owned());
    names
        .filter_map(|name| {
            let shadow = board.instances(&name).rev().find(is_shadow)?;
            // Each instance reports once a second: the one that leads must have, too.
            board.get(&name).filter(|health| leads(health))?;
            let kind = kind_of(domain, &name, shadow.epoch)?;
            Some(Found { name, kind, shadow: (shadow.epoch, shadow.pid) })
        })
        .collect()
}

/// The kind of an instance that was started beside another: its pipeline file is in the domain's folder.
fn kind_of(domain: &Domain, name: &str, epoch: u32) -> Option<String> {
    let pipeline = Pipeline::read(&domain.folder().join(format!("{name}-{epoch}.toml"))).ok()?;
    Some(pipeline.stage(name)?.kind.clone())
}

struct Watch<'a> {
    args: &'a CompareArgs,
    domain: &'a Domain,
    bus: &'a Bus,
    board: HealthBoard,
    health: Listener,
    found: Found,
}

impl Watch<'_> {
    fn run<P: Port>(
        mut self,
        buses: [&Bus; 2],
        measures: Measures,
        mut deviation: impl FnMut(&P::Item, &P::Item) -> Option<[f64; 2]>,
    ) -> Result<Comparison, LaunchError> {
        let (mut pairs, [first, second]) = Pairs::<P>::open(buses)?;
        let Found { name, kind, shadow } = &self.found;
        let led = self.board.get(name).map_or((0, 0), |health| (health.epoch, health.pid));
        let led_kind = kind_of(self.domain, name, led.0).unwrap_or_else(|| name.clone());
        let side = |kind: &str, (epoch, pid): (u32, u32)| Side {
            name: if epoch == 0 { kind.to_owned() } else { format!("{kind} #{epoch}") },
            pid: Some(pid),
            ..Side::default()
        };
        let mut comparison = Comparison {
            about: name.clone(),
            sides: [side(&led_kind, led), side(kind, *shadow)],
            measures,
            latency: "end to end",
            unmatched: 0,
            rows: Vec::new(),
        };
        let pids = [led.1, shadow.1];
        let (begun, cpu) = (Instant::now(), pids.map(cpu_s));
        let until = self.args.duration.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let mut display = Display::new();
        let listeners = [first, second, self.health];
        let mut uncomparable = 0;
        let mut start_ns = None;
        let (board, domain, bus) = (&mut self.board, self.domain, self.bus);
        wait_on(&listeners, |wake| {
            let taken = board.take_in().and_then(|()| {
                pairs.take_in(|a, b| {
                    let (at, beside) = (P::frame(a), P::frame(b));
                    let Some(deviation) = deviation(a, b) else {
                        uncomparable += 1;
                        return;
                    };
                    let start_ns = *start_ns.get_or_insert(at.end_ns);
                    let time_s = at.end_ns.saturating_sub(start_ns) as f64 * 1e-9;
                    let latency_ms = [at, beside].map(latency_ms);
                    comparison.rows.push(Row { seq: at.seq, time_s, deviation, latency_ms });
                })
            });
            if let Err(cause) = taken {
                return ControlFlow::Break(Err(cause));
            }
            comparison.unmatched = pairs.unmatched + uncomparable;
            for (index, side) in comparison.sides.iter_mut().enumerate() {
                side.frames = pairs.frames()[index];
                let since = begun.elapsed().as_secs_f64();
                side.cpu_percent = match (cpu[index], cpu_s(pids[index])) {
                    (Some(then), Some(now)) if since > 0.0 => Some((now - then) / since * 100.0),
                    // Of one that has ended the last figure stays.
                    _ => side.cpu_percent,
                };
            }
            display.show(&comparison);
            let has_ended = cpu_s(shadow.1).is_none() || domain.holder().is_none();
            let is_over = until.is_some_and(|until| begun.elapsed() >= until);
            if wake == Wake::Stop || bus.stop_requested() || has_ended || is_over {
                return ControlFlow::Break(Ok::<(), PortError>(()));
            }
            let left = until.map_or(REDRAW, |until| until.saturating_sub(begun.elapsed()));
            ControlFlow::Continue(left.clamp(Duration::from_millis(10), REDRAW))
        })??;
        display.end();
        if comparison.rows.is_empty() {
            return Err(LaunchError::Silent(format!(
                "no frame came from both instances of '{name}' ({} and {} frames, {} that are not of the same points)",
                comparison.sides[0].frames, comparison.sides[1].frames, uncomparable
            )));
        }
        Ok(comparison)
    }
}

/// From the arrival of a scan's last byte on the host to the hand-over of what came of it.
fn latency_ms(frame: &FrameHeader) -> f64 {
    frame.sent_ns.saturating_sub(frame.arrival_ns) as f64 * 1e-6
}

/// The table, in place on a terminal, now and then one line elsewhere.
struct Display {
    bar: ProgressBar,
    shown: Option<Instant>,
}

impl Display {
    fn new() -> Self {
        Self { bar: progress::text(), shown: None }
    }

    fn show(&mut self, comparison: &Comparison) {
        let interval = if self.bar.is_hidden() { LINE } else { REDRAW };
        if self.shown.is_some_and(|shown| shown.elapsed() < interval) {
            return;
        }
        let Some(last) = comparison.rows.last() else { return };
        self.shown = Some(Instant::now());
        if self.bar.is_hidden() {
            let [first, second] = comparison.measures.labels;
            let [a, b] = last.deviation;
            // Nobody reads it where it is closed.
            let _ = writeln!(std::io::stderr(), "frame {}: {first} {a:.3}, {second} {b:.3}", last.seq);
        } else {
            self.bar.set_message(comparison.table());
        }
    }

    /// Removes the table: the last one goes to the output.
    fn end(&self) {
        self.bar.finish_and_clear();
    }
}
