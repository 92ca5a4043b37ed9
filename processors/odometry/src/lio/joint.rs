//! What a scan shows about the filter's own pose and the places of older sections together.

use evac_geometry::nalgebra::{SMatrix, SVector};

use super::information::Information;
use super::offset::PoseCovariance;
use super::state::{Covariance, DIM, MEASURED, OWN, PLACES};

/// Dimension of what is seen: the measured part of the filter's own error, and the places.
pub(crate) const SEEN: usize = MEASURED + PLACES;

/// Information about both.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Joint {
    pub(crate) matrix: SMatrix<f64, SEEN, SEEN>,
    pub(crate) vector: SVector<f64, SEEN>,
}

impl Default for Joint {
    fn default() -> Self {
        Self { matrix: SMatrix::zeros(), vector: SVector::zeros() }
    }
}

impl Joint {
    /// Adds information about the own pose alone.
    pub(crate) fn add(&mut self, sum: &Information) {
        let mut own = self.matrix.fixed_view_mut::<MEASURED, MEASURED>(0, 0);
        own += sum.matrix;
        let mut own = self.vector.fixed_rows_mut::<MEASURED>(0);
        own += sum.vector;
    }

    /// Adds what is matched with the section whose place is the clone `slot`: a displacement `o` of it looks like a pose error `-M o`,
    /// where `M` is `by_offset`.
    pub(crate) fn add_displaced(&mut self, sum: &Information, slot: usize, by_offset: &PoseCovariance) {
        self.add(sum);
        let place = MEASURED + 6 * slot;
        let cross = -(sum.matrix.fixed_columns::<6>(0) * by_offset);
        let mut above = self.matrix.fixed_view_mut::<MEASURED, 6>(0, place);
        above += cross;
        let mut below = self.matrix.fixed_view_mut::<6, MEASURED>(place, 0);
        below += cross.transpose();
        let mut square = self.matrix.fixed_view_mut::<6, 6>(place, place);
        square -= by_offset.transpose() * cross.fixed_rows::<6>(0);
        let mut vector = self.vector.fixed_rows_mut::<6>(place);
        vector -= by_offset.transpose() * sum.vector.fixed_rows::<6>(0);
    }
}

/// Columns of the covariance that belong to what is seen.
pub(crate) fn seen_columns(covariance: &Covariance) -> SMatrix<f64, DIM, SEEN> {
    let mut columns = SMatrix::<f64, DIM, SEEN>::zeros();
    columns.fixed_columns_mut::<MEASURED>(0).copy_from(&covariance.fixed_columns::<MEASURED>(0));
    columns.fixed_columns_mut::<PLACES>(MEASURED).copy_from(&covariance.fixed_columns::<PLACES>(OWN));
    columns
}

/// Rows of the same.
pub(crate) fn seen_rows<const COLUMNS: usize>(
    all: &SMatrix<f64, DIM, COLUMNS>,
) -> SMatrix<f64, SEEN, COLUMNS> {
    let mut rows = SMatrix::<f64, SEEN, COLUMNS>::zeros();
    rows.fixed_rows_mut::<MEASURED>(0).copy_from(&all.fixed_rows::<MEASURED>(0));
    rows.fixed_rows_mut::<PLACES>(MEASURED).copy_from(&all.fixed_rows::<PLACES>(OWN));
    rows
}
