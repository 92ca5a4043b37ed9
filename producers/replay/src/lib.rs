//! evac-replay
