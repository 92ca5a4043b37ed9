//! Classic libpcap captures: UDP over IPv4 in, one datagram at a time, and out.

mod link;
mod reader;
mod writer;

pub use reader::{PcapCounts, PcapReader, UdpDatagram};
pub use writer::PcapWriter;
