//! What tests share.

mod allocations;
mod data;

pub use allocations::{CountingAllocator, count_allocations};
pub use data::{data, unpacked};
