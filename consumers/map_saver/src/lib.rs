//! evac-map-saver
