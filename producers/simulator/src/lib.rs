//! evac-simulator
