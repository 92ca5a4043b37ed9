//! A trajectory against the truth.
//!
//! Poses of one time are paired ([`associate`], [`Pairs`]) and give the figures that the field compares ([`Evaluation`]):
//! absolute pose error after two alignments, relative pose error over a second and over a metre, the drift at the end,
//! and the ten figures of the paper's Table 1 over the heights.
//!
//! ```
//! use evac_evaluation::{Evaluation, Pairs};
//! use evac_geometry::nalgebra::Isometry3;
//!
//! // 10 m in 10 s, of which the estimate has 1 % too many.
//! let stamps_ns: Vec<i64> = (0..=100).map(|i| i * 100_000_000).collect();
//! let walk = |scale: f64| -> Vec<_> {
//!     (0..=100).map(|i| Isometry3::translation(f64::from(i) * 0.1 * scale, 0.0, 0.0)).collect()
//! };
//! let pairs = Pairs::from_poses(&stamps_ns, &walk(1.0), &walk(1.01))?;
//! let figures = Evaluation::of(&pairs).ok_or("fewer than two frames")?;
//! assert!((figures.end_percent - 1.0).abs() < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Definitions are those of evo (Grupp, 2017: `evo_ape`, `evo_rpe`), so figures can be compared with published ones:
//!
//! - **Absolute error** (translation part): distance between the true position and the aligned estimate's, frame by
//!   frame. *SE(3)* alignment is the rigid transform with the least squared distances (Umeyama 1991, no scale: evo's
//!   `--align`); *first-pose* alignment lays the first poses on each other (`--align_origin`), so that it also shows what
//!   an error at the start does to the end.
//! - **Relative error** of a pair of frames i, j: `E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j)` with the truth Q and the estimate P,
//!   its translation's norm and its rotation's angle; over all pairs (`--all_pairs`) that are one second
//!   or one metre of true path (`--pairs_from_reference`) apart.
//! - **Standard deviation** of an error is that of the population (divided by n, as numpy's); the one of the
//!   [`Figures`] is the sample's (n - 1, as in the paper).
//!
//! Units: metres, degrees, nanoseconds. Transforms are `truth_from_estimate`: estimated map coordinates to true ones.

mod alignment;
mod error;
mod evaluation;
mod figures;
mod pairs;
mod relative;
mod statistics;

pub use error::{EvaluationError, Side};
pub use evaluation::Evaluation;
pub use figures::Figures;
pub use pairs::{Pairs, associate, associate_absolute};
pub use relative::RelativeError;
pub use statistics::Statistics;
