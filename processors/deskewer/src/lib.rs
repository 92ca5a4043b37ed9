//! evac-deskewer
