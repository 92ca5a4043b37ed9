//! evac-ports
