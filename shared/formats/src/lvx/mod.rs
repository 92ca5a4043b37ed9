//! Recordings of Livox Viewer and of the maker's samples: LVX 1.0 and 1.1 (first protocol) and LVX2 (second). Frames of about
//! 50 ms of host time hold data packets of all devices in the order of arrival.

mod header;
mod reader;

pub use header::{Device, Version};
pub use reader::{LvxPacket, LvxReader};
