// A cloud into a .bt with OctoMap's library and without PCL. The Rust side (src/bin/conversion.rs) starts this and `evac convert` and
// compares the files.
//
// conversion CLOUD.pcd RESOLUTION MAP.bt [RADIUS NEIGHBOURS]
//   CLOUD: PCD 0.7, DATA binary, the first three fields x, y and z as 4-byte floats
//   RADIUS NEIGHBOURS: leaves out points with fewer others within the radius, counted in a hashed grid

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>
#include <unordered_map>
#include <vector>

#include <octomap/octomap.h>

namespace {

std::vector<octomap::point3d> read_pcd(const char* path) {
  std::ifstream file(path, std::ios::binary);
  std::string line;
  size_t points = 0, record = 0;
  while (std::getline(file, line)) {
    std::istringstream words(line);
    std::string key;
    words >> key;
    if (key == "SIZE") {
      for (size_t size; words >> size;) record += size;
    } else if (key == "POINTS") {
      words >> points;
    } else if (key == "DATA") {
      break;
    }
  }
  std::vector<char> data(points * record);
  file.read(data.data(), static_cast<std::streamsize>(data.size()));
  if (!file || record < 12) std::exit(1);
  std::vector<octomap::point3d> cloud;
  cloud.reserve(points);
  for (size_t i = 0; i < points; ++i) {
    float p[3];
    std::memcpy(p, data.data() + i * record, sizeof p);
    cloud.emplace_back(p[0], p[1], p[2]);
  }
  return cloud;
}

uint64_t cell_of(int32_t x, int32_t y, int32_t z) {
  const auto part = [](int32_t v) { return static_cast<uint64_t>(v) & 0x1fffff; };
  return part(x) | part(y) << 21 | part(z) << 42;
}

std::vector<octomap::point3d> without_outliers(const std::vector<octomap::point3d>& cloud, float radius, int needed) {
  std::unordered_map<uint64_t, std::vector<uint32_t>> cells;
  const auto index = [radius](float v) { return static_cast<int32_t>(std::floor(v / radius)); };
  for (uint32_t i = 0; i < cloud.size(); ++i)
    cells[cell_of(index(cloud[i].x()), index(cloud[i].y()), index(cloud[i].z()))].push_back(i);
  std::vector<octomap::point3d> kept;
  for (const auto& p : cloud) {
    int found = -1;  // itself
    const int32_t x = index(p.x()), y = index(p.y()), z = index(p.z());
    for (int32_t dz = -1; dz <= 1 && found < needed; ++dz)
      for (int32_t dy = -1; dy <= 1 && found < needed; ++dy)
        for (int32_t dx = -1; dx <= 1 && found < needed; ++dx) {
          const auto cell = cells.find(cell_of(x + dx, y + dy, z + dz));
          if (cell == cells.end()) continue;
          for (const uint32_t i : cell->second) {
            const float a = cloud[i].x() - p.x(), b = cloud[i].y() - p.y(), c = cloud[i].z() - p.z();
            if (a * a + b * b + c * c <= radius * radius && ++found >= needed) break;
          }
        }
    if (found >= needed) kept.push_back(p);
  }
  return kept;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4 && argc != 6) {
    std::fprintf(stderr, "usage: conversion CLOUD.pcd RESOLUTION MAP.bt [RADIUS NEIGHBOURS]\n");
    return 2;
  }
  auto cloud = read_pcd(argv[1]);
  if (argc == 6) cloud = without_outliers(cloud, static_cast<float>(std::atof(argv[4])), std::atoi(argv[5]));
  octomap::OcTree tree(std::atof(argv[2]));
  for (const auto& point : cloud) tree.updateNode(point, true);
  return tree.writeBinary(argv[3]) ? 0 : 1;
}
