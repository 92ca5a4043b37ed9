//! The three filters of section 3.1 on a cloud of any size.

use evac_stage::check_range;

use super::CloudSource;
use super::counts::{Class, Counts};
use super::undecided::Undecided;
use crate::check::positive;
use crate::ground::{CloudGround, GroundColumns};
use crate::{BoundsConfig, GroundConfig};

/// Undecided points that wait at the same time (28 bytes each, and an index of their places).
const BATCH: usize = 4_000_000;
/// Most blocks of counts: 0.1 kB each.
const MOST_BLOCKS: usize = 12_000_000;
/// Most pieces of columns that ground is looked for in: 0.1 kB each.
const MOST_PIECES: usize = 12_000_000;

/// Radius outlier removal for a cloud without sensor positions: a point goes when fewer than `min_neighbours` others lie
/// within `radius_m`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudOutlierConfig {
    /// Radius, metres.
    pub radius_m: f64,
    /// Fewest other points, 1 to 254.
    pub min_neighbours: u8,
}

/// Which filters run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CloudFilterConfig {
    /// Radius outlier removal; `None` keeps all.
    pub outliers: Option<CloudOutlierConfig>,
    /// Conditional filter, of which only the limits of x, y and z apply.
    pub bounds: BoundsConfig,
    /// Ground filter; `None` keeps the ground.
    pub ground: Option<GroundConfig>,
    /// Points with a coordinate beyond this are outside: the map's keys end there. Metres.
    pub reach_m: f64,
}

/// What a point is that was not removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// It is an obstacle.
    Kept,
    /// It is ground: it clears but does not occupy.
    Ground,
}

/// Points by what became of them; their sum is the cloud.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Removed {
    /// A coordinate was NaN or infinite.
    pub not_finite: u64,
    /// Outside the limits of the conditional filter.
    pub outside: u64,
    /// Beyond the reach of the map's keys.
    pub unreachable: u64,
    /// Too few others near.
    pub outliers: u64,
    /// Ground.
    pub ground: u64,
    /// Kept as obstacles.
    pub kept: u64,
}

/// Why a cloud was not filtered.
#[derive(Debug, thiserror::Error)]
pub enum CloudFilterError<E> {
    /// It could not be read.
    #[error("{0}")]
    Source(E),
    /// What is kept by places would take too much memory.
    #[error("the {filter} filter needs more than {most} places in memory; {remedy}")]
    TooLarge {
        /// Which filter.
        filter: &'static str,
        /// Its ceiling.
        most: usize,
        /// What to try.
        remedy: &'static str,
    },
}

/// What the passes before the judgement have found.
#[derive(Debug, Default)]
struct Survey {
    counts: Option<Counts>,
    ground: Option<CloudGround>,
}

/// Filters a cloud that is read several times and never held.
///
/// - First pass: points within the limits are counted by small cubes (edge: radius over root 3) and by columns of
///   0.25 x 0.25 m in slices of 2 cm. The columns' slices give surfaces.
/// - Second pass, for ground only: the moments of the points in each surface, from which planes and patches follow as in
///   [`GroundFilter`](crate::GroundFilter).
/// - Last pass: each point is judged. Cubes with more points than are needed hold inliers, cubes with too few in reach
///   outliers. Points between wait, at most four million at a time, and the cloud is read once more for each such batch to
///   compare them with every point near. So the answer is exact, and does not depend on the points' order.
///
/// Ground is told from all points within the limits, outliers included; a point that is both counts as outlier.
#[derive(Debug, Clone, Copy)]
pub struct CloudFilter {
    config: CloudFilterConfig,
    batch: usize,
}

impl CloudFilter {
    /// A filter.
    ///
    /// # Errors
    /// One sentence about a value out of range.
    pub fn new(config: CloudFilterConfig) -> Result<Self, String> {
        if let Some(outliers) = config.outliers {
            check_range("radius", outliers.radius_m, 0.001, 100.0, "0.1 m suits indoor clouds")?;
            if !(1..=254).contains(&outliers.min_neighbours) {
                return Err(format!("{} neighbours; give 1 to 254", outliers.min_neighbours));
            }
        }
        config.bounds.check()?;
        positive("reach", config.reach_m, "32768 voxels")?;
        if let Some(ground) = config.ground {
            ground.check()?;
        }
        Ok(Self { config, batch: BATCH })
    }

    /// The same with smaller batches, for tests.
    #[doc(hidden)]
    pub fn with_batch(self, batch: usize) -> Self {
        Self { batch: batch.max(1), ..self }
    }

    /// Calls `visit` once with every point that stays or is ground.
    ///
    /// # Errors
    /// [`CloudFilterError`].
    pub fn run<S: CloudSource>(
        &self,
        source: &mut S,
        mut visit: impl FnMut([f32; 3], Verdict),
    ) -> Result<Removed, CloudFilterError<S::Error>> {
        let mut removed = Removed::default();
        let Survey { counts, mut ground } = self.survey(source, &mut removed)?;
        let surveyed = ground.is_some();
        let mut judge = |point, removed: &mut Removed| {
            if ground.as_mut().is_some_and(|ground| ground.is_ground(point)) {
                removed.ground += 1;
                visit(point, Verdict::Ground);
            } else {
                removed.kept += 1;
                visit(point, Verdict::Kept);
            }
        };
        let Some((outliers, counts)) = self.config.outliers.zip(counts) else {
            source
                .each(|point| {
                    if self.admits(point, (!surveyed).then_some(&mut removed)) {
                        judge(point, &mut removed);
                    }
                })
                .map_err(CloudFilterError::Source)?;
            return Ok(removed);
        };
        let batch = || Undecided::new(outliers.radius_m as f32, outliers.min_neighbours);
        let (mut waiting, mut judged) = (batch(), 0);
        loop {
            let (mut next, mut at) = (batch(), 0_u64);
            source
                .each(|point| {
                    if !self.admits(point, None) {
                        return;
                    }
                    if waiting.len() > 0 {
                        waiting.see(&counts, point);
                    }
                    at += 1;
                    if at <= judged || next.len() >= self.batch {
                        return;
                    }
                    judged = at;
                    match counts.class(point) {
                        Class::Inlier => judge(point, &mut removed),
                        Class::Outlier => removed.outliers += 1,
                        Class::Undecided => next.push(&counts, point),
                    }
                })
                .map_err(CloudFilterError::Source)?;
            waiting.settle(
                |point, inlier| {
                    if inlier { judge(point, &mut removed) } else { removed.outliers += 1 }
                },
            );
            if next.len() == 0 {
                return Ok(removed);
            }
            next.arrange();
            waiting = next;
        }
    }

    /// The passes before the judgement, as many as the filters need.
    fn survey<S: CloudSource>(
        &self,
        source: &mut S,
        removed: &mut Removed,
    ) -> Result<Survey, CloudFilterError<S::Error>> {
        let mut counts =
            self.config.outliers.map(|config| Counts::new(config.radius_m, config.min_neighbours));
        let mut columns = self.config.ground.filter(|config| config.enabled).map(GroundColumns::new);
        if counts.is_none() && columns.is_none() {
            return Ok(Survey::default());
        }
        let mut too_large = None;
        source
            .each(|point| {
                if too_large.is_some() || !self.admits(point, Some(removed)) {
                    return;
                }
                if let Some(counts) = &mut counts {
                    counts.add(point);
                    if counts.blocks() > MOST_BLOCKS {
                        too_large =
                            Some(("outlier", MOST_BLOCKS, "give a larger radius or limits of x, y and z"));
                    }
                }
                if let Some(columns) = &mut columns {
                    columns.add(point);
                    if columns.pieces() > MOST_PIECES {
                        too_large = Some(("ground", MOST_PIECES, "give limits of x, y and z"));
                    }
                }
            })
            .map_err(CloudFilterError::Source)?;
        if let Some((filter, most, remedy)) = too_large {
            return Err(CloudFilterError::TooLarge { filter, most, remedy });
        }
        if let Some(counts) = &mut counts {
            counts.classify();
        }
        let Some(columns) = columns else { return Ok(Survey { counts, ground: None }) };
        let mut ground = columns.surfaces();
        source
            .each(|point| {
                if self.admits(point, None) {
                    ground.add(point);
                }
            })
            .map_err(CloudFilterError::Source)?;
        ground.judge();
        Ok(Survey { counts, ground: Some(ground) })
    }

    /// Whether a point is looked at at all; the reason goes into `removed`.
    fn admits(&self, point: [f32; 3], removed: Option<&mut Removed>) -> bool {
        let finite = point.iter().all(|axis| axis.is_finite());
        let reachable = finite && point.iter().all(|axis| f64::from(axis.abs()) < self.config.reach_m);
        let inside = reachable && self.config.bounds.keeps_place(point);
        if let Some(removed) = removed.filter(|_| !inside) {
            let reason = match (finite, reachable) {
                (false, _) => &mut removed.not_finite,
                (_, false) => &mut removed.unreachable,
                _ => &mut removed.outside,
            };
            *reason += 1;
        }
        inside
    }
}
