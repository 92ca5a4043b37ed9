//! The simulated sensors as devices that real drivers talk to.

pub mod livox;
pub mod wt901c;
