//! Calibration from motion: the rotation between LiDAR and IMU, the scale of the gyroscope and the offset between the two
//! clocks, each with its standard error.
//!
//! What the LiDAR turned by from scan to scan, by itself, is compared with what the gyroscope turned by. Both agree for
//! one rotation, scale, bias and clock offset only, as far as the walk has turned about different axes and at changing
//! rates. [`calibrate`] runs deskewer and odometry over a walk with what is known, solves for the rest by least squares,
//! corrects the walk and repeats until nothing changes any more.
//!
//! Equations: hand-eye calibration on rotations (Park and Martin 1994) in the continuous form of Furgale et al. 2013
//! (Kalibr), with the gyroscope integrated instead of fitted by splines; standard errors that hold for
//! errors which are alike within a stretch of some seconds (clustered "sandwich" covariance, Liang and Zeger 1986).

mod calibrate;
mod correction;
mod fit;
mod gyro;
mod observation;
mod result;
mod windows;

pub use calibrate::{CalibrationError, Progress, calibrate};
pub use correction::Correction;
pub use result::{Calibration, Estimate, Quantity};
