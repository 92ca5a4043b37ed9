//! evac-octree
