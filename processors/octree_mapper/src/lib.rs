//! evac-octree-mapper
