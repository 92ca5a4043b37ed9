//! A WT901C on a pseudo-terminal: registers, commands and frames as on the wire, with faults on request.
//!
//! [`Module`] is the module without a line: bytes in, bytes out. [`Port`] puts it on a pseudo-terminal whose slave a driver
//! opens by the path of a link; whoever has samples feeds it in real time. [`Bench`] is a port in a thread of its own.

mod bench;
mod module;
mod port;

pub use bench::Bench;
pub use module::{Line, Module};
pub use port::{Faults, Port};
