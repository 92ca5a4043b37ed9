//! evac-grid-exporter
