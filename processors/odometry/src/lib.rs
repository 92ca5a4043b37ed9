//! evac-odometry
