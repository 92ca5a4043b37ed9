//! A station hall of 34 x 20 m and 5 m height.

use super::build::Site;
use crate::trajectory::Route;
pub(super) fn route(start: impl Fn([f64; 3], f64) -> Route) -> Route {
    start([4.0, 10.0, 0.0], 0.0).stand(3.0)
}
pub(super) fn build() -> Site {
    Site::default()
}
