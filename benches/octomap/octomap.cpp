// Inserts scans with OctoMap's library and says what it cost. The Rust side (src/main.rs) writes the scans, starts this
// and compares the files.
//
// octomap SCANS RESOLUTION MAX_RANGE MODE QUERIES FOLDER CHECKPOINT...
//   SCANS: per scan origin (3 f32), number of points (u32), points (3 f32 each), little endian
//   MODE: exact | discretized (lazy and discretize, as octomap_server has it)
//   QUERIES: queries | none, on the last map
// Prints one line `key value` a figure; times are processor times in milliseconds. FOLDER gets N.ot after N scans.

#include <malloc.h>
#include <time.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include <octomap/octomap.h>

namespace {

double cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

size_t heap_bytes() {
  const auto info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

struct Scan {
  octomap::point3d origin;
  octomap::Pointcloud points;
};

bool read_scan(std::ifstream& file, Scan& scan) {
  float origin[3];
  uint32_t count = 0;
  if (!file.read(reinterpret_cast<char*>(origin), sizeof origin)) return false;
  file.read(reinterpret_cast<char*>(&count), sizeof count);
  std::vector<float> points(3 * static_cast<size_t>(count));
  file.read(reinterpret_cast<char*>(points.data()), static_cast<std::streamsize>(points.size() * sizeof(float)));
  scan.origin = octomap::point3d(origin[0], origin[1], origin[2]);
  scan.points.clear();
  scan.points.reserve(count);
  for (size_t i = 0; i < count; ++i) scan.points.push_back(points[3 * i], points[3 * i + 1], points[3 * i + 2]);
  return static_cast<bool>(file);
}

// The same numbers as the Rust side draws (`Lcg` in src/queries.rs).
struct Lcg {
  uint64_t state;
  double uniform() {
    state = state * 6364136223846793005ULL + 1442695040888963407ULL;
    return static_cast<double>(state >> 11) * 0x1p-53;
  }
};

constexpr int kCasts = 2000;
constexpr int kBoxes = 2000;

void queries(octomap::OcTree& tree, const octomap::point3d& at, double max_range, const std::string& folder) {
  {
    const double start = cpu_ms();
    size_t leaves = 0;
    double sum = 0;
    for (auto it = tree.begin_leafs(), end = tree.end_leafs(); it != end; ++it) {
      ++leaves;
      sum += it->getLogOdds();
    }
    std::printf("leaves_ms %.6f\nleaves %zu\nleaves_sum %.9g\n", cpu_ms() - start, leaves, sum);
  }
  {
    Lcg random{1};
    const double start = cpu_ms();
    size_t leaves = 0;
    for (int i = 0; i < kBoxes; ++i) {
      float low[3];
      for (int axis = 0; axis < 3; ++axis) {
        const double reach = axis == 2 ? 2.0 : 10.0;
        low[axis] = static_cast<float>(at(axis) + (random.uniform() * 2.0 - 1.0) * reach);
      }
      const octomap::point3d min(low[0], low[1], low[2]);
      const octomap::point3d max(low[0] + 1.0f, low[1] + 1.0f, low[2] + 1.0f);
      for (auto it = tree.begin_leafs_bbx(min, max), end = tree.end_leafs_bbx(); it != end; ++it) ++leaves;
    }
    std::printf("boxes_ms %.6f\nboxes %zu\n", cpu_ms() - start, leaves);
  }
  {
    Lcg random{2};
    const double start = cpu_ms();
    size_t hits = 0;
    double sum = 0;
    for (int i = 0; i < kCasts; ++i) {
      float d[3];
      for (float& axis : d) axis = static_cast<float>(random.uniform() * 2.0 - 1.0);
      d[2] *= 0.25f;
      octomap::point3d end;
      if (tree.castRay(at, octomap::point3d(d[0], d[1], d[2]), end, true, max_range)) {
        ++hits;
        sum += end.x() + end.y() + end.z();
      }
    }
    std::printf("casts_ms %.6f\ncasts %zu\ncasts_sum %.9g\n", cpu_ms() - start, hits, sum);
  }
  {
    double start = cpu_ms();
    std::ostringstream out;
    tree.write(out);
    std::printf("write_ot_ms %.6f\n", cpu_ms() - start);
    const std::string bytes = out.str();
    std::istringstream in(bytes);
    start = cpu_ms();
    std::unique_ptr<octomap::AbstractOcTree> read(octomap::AbstractOcTree::read(in));
    std::printf("read_ot_ms %.6f\n", cpu_ms() - start);
  }
  {
    // As user code merges two maps: each voxel of the other is an update. Here a map with itself.
    octomap::OcTree other(tree);
    octomap::OcTree sum(tree);
    const double start = cpu_ms();
    other.expand();
    for (auto it = other.begin_leafs(), end = other.end_leafs(); it != end; ++it)
      sum.updateNode(it.getKey(), it->getLogOdds(), true);
    sum.updateInnerOccupancy();
    sum.prune();
    std::printf("merge_ms %.6f\n", cpu_ms() - start);
    sum.write(folder + "/merged.ot");
  }
  {
    octomap::OcTree copy(tree);
    copy.expand();
    const double start = cpu_ms();
    copy.prune();
    std::printf("prune_ms %.6f\n", cpu_ms() - start);
  }
  {
    // writeBinary is maximum likelihood, prune and write.
    octomap::OcTree copy(tree);
    std::ostringstream out;
    double start = cpu_ms();
    copy.writeBinary(out);
    std::printf("write_bt_ms %.6f\n", cpu_ms() - start);
    const std::string bytes = out.str();
    std::ofstream(folder + "/map.bt", std::ios::binary) << bytes;
    std::istringstream in(bytes);
    octomap::OcTree read(tree.getResolution());
    start = cpu_ms();
    read.readBinary(in);
    std::printf("read_bt_ms %.6f\n", cpu_ms() - start);
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 8) {
    std::fprintf(stderr, "usage: octomap SCANS RESOLUTION MAX_RANGE exact|discretized queries|none FOLDER CHECKPOINT...\n");
    return 2;
  }
  const double resolution = std::atof(argv[2]), max_range = std::atof(argv[3]);
  const bool discretized = std::string(argv[4]) == "discretized";
  const bool ask = std::string(argv[5]) == "queries";
  const std::string folder = argv[6];
  std::vector<int> checkpoints;
  for (int i = 7; i < argc; ++i) checkpoints.push_back(std::atoi(argv[i]));

  std::ifstream file(argv[1], std::ios::binary);
  octomap::OcTree tree(resolution);
  Scan scan;
  size_t next = 0;
  // The scan's own memory grows once; what the tree takes is measured around it.
  size_t tree_heap = 0;
  for (int count = 1; next < checkpoints.size() && read_scan(file, scan); ++count) {
    const size_t before = heap_bytes();
    const double start = cpu_ms();
    tree.insertPointCloud(scan.points, scan.origin, max_range, discretized, discretized);
    std::printf("scan_ms %.6f\n", cpu_ms() - start);
    tree_heap += heap_bytes() - before;
    if (count != checkpoints[next]) continue;
    if (discretized) {
      const double start_prune = cpu_ms();
      tree.updateInnerOccupancy();
      tree.prune();
      std::printf("finish_ms %.6f\n", cpu_ms() - start_prune);
    }
    tree.write(folder + "/" + std::to_string(count) + ".ot");
    std::printf("heap_bytes %zu\nmemory_usage %zu\nnodes %zu\n", tree_heap, tree.memoryUsage(), tree.size());
    ++next;
    if (next == checkpoints.size() && ask) queries(tree, scan.origin, max_range, folder);
    std::fflush(stdout);
  }
  return next == checkpoints.size() ? 0 : 1;
}
