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

#include <algorithm>
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
constexpr size_t kRounds = 5;
// Rounds of what takes less than kShortMs: one interruption must not be the answer.
constexpr size_t kManyRounds = 25;
constexpr double kShortMs = 5.0;

// Median processor time of a few rounds; `prepare` is not timed.
template <typename Prepare, typename Work>
double median_ms(Prepare prepare, Work work) {
  std::vector<double> times;
  while (times.size() < kRounds || (times.size() < kManyRounds && times.back() < kShortMs)) {
    auto state = prepare();
    const double start = cpu_ms();
    work(state);
    times.push_back(cpu_ms() - start);
  }
  std::sort(times.begin(), times.end());
  return times[times.size() / 2];
}

template <typename Work>
double median_ms(Work work) {
  return median_ms([] { return 0; }, [&work](int) { work(); });
}

// Calls `visit` with each leaf of the boxes and the box.
template <typename Visit>
void for_each_in_boxes(const octomap::OcTree& tree, const octomap::point3d& at, Visit visit) {
  Lcg random{1};
  for (int i = 0; i < kBoxes; ++i) {
    float low[3];
    for (int axis = 0; axis < 3; ++axis) {
      const double reach = axis == 2 ? 2.0 : 10.0;
      low[axis] = static_cast<float>(at(axis) + (random.uniform() * 2.0 - 1.0) * reach);
    }
    const octomap::point3d min(low[0], low[1], low[2]);
    const octomap::point3d max(low[0] + 1.0f, low[1] + 1.0f, low[2] + 1.0f);
    for (auto it = tree.begin_leafs_bbx(min, max), end = tree.end_leafs_bbx(); it != end; ++it) visit(it, min, max);
  }
}

void queries(octomap::OcTree& tree, const octomap::point3d& at, double max_range, const std::string& folder) {
  {
    size_t leaves = 0;
    double sum = 0;
    const double ms = median_ms([&] {
      leaves = 0;
      sum = 0;
      for (auto it = tree.begin_leafs(), end = tree.end_leafs(); it != end; ++it) {
        ++leaves;
        sum += it->getLogOdds();
      }
    });
    std::printf("leaves_ms %.6f\nleaves %zu\nleaves_sum %.9g\n", ms, leaves, sum);
  }
  {
    double sum = 0;
    const double ms = median_ms([&] {
      sum = 0;
      for_each_in_boxes(tree, at, [&sum](auto& it, auto&, auto&) { sum += it->getLogOdds() + it.getDepth(); });
    });
    // The voxels that leaves and boxes share: the same whether a large leaf is told whole or in parts.
    size_t voxels = 0;
    double weighed = 0;
    for_each_in_boxes(tree, at, [&](auto& it, auto& min, auto& max) {
      const octomap::OcTreeKey low = tree.coordToKey(min), high = tree.coordToKey(max), key = it.getIndexKey();
      const int edge = 1 << (16 - it.getDepth());
      size_t shared = 1;
      for (int axis = 0; axis < 3; ++axis) {
        const int from = std::max<int>(low[axis], key[axis]), to = std::min<int>(high[axis], key[axis] + edge - 1);
        shared *= static_cast<size_t>(std::max(0, to - from + 1));
      }
      voxels += shared;
      weighed += static_cast<double>(shared) * it->getLogOdds();
    });
    std::printf("boxes_ms %.6f\nboxes %zu\nboxes_sum %.9g\n", ms, voxels, weighed);
    if (sum == 0.5) std::printf("unlikely %.9g\n", sum);  // so that the timed loop has a purpose
  }
  {
    size_t hits = 0;
    double sum = 0;
    const double ms = median_ms([&] {
      Lcg random{2};
      hits = 0;
      sum = 0;
      for (int i = 0; i < kCasts; ++i) {
        float d[3];
        for (float& axis : d) axis = static_cast<float>(random.uniform() * 2.0 - 1.0);
        d[2] *= 0.25f;
        octomap::point3d end;
        hits += tree.castRay(at, octomap::point3d(d[0], d[1], d[2]), end, true, max_range);
        sum += end.x() + end.y() + end.z();
      }
    });
    std::printf("casts_ms %.6f\ncasts %zu\ncasts_sum %.9g\n", ms, hits, sum);
  }
  {
    std::string bytes;
    std::printf("write_ot_ms %.6f\n", median_ms([&] {
      std::ostringstream out;
      tree.write(out);
      bytes = out.str();
    }));
    // The messages of OctoMap's readers go to stderr.
    std::unique_ptr<octomap::AbstractOcTree> read;
    std::printf("read_ot_ms %.6f\n", median_ms([&] {
      read.reset();
      return std::make_unique<std::istringstream>(bytes);
    }, [&](auto& in) { read.reset(octomap::AbstractOcTree::read(*in)); }));
  }
  {
    // As user code merges two maps: each voxel of the other is an update. Here a map with itself.
    std::unique_ptr<octomap::OcTree> sum;
    std::printf("merge_ms %.6f\n", median_ms([&] {
      sum = std::make_unique<octomap::OcTree>(tree);
      auto other = std::make_unique<octomap::OcTree>(tree);
      other->expand();
      return other;
    }, [&](auto& other) {
      for (auto it = other->begin_leafs(), end = other->end_leafs(); it != end; ++it)
        sum->updateNode(it.getKey(), it->getLogOdds(), true);
      sum->updateInnerOccupancy();
      sum->prune();
    }));
    sum->write(folder + "/merged.ot");
  }
  {
    size_t nodes = 0;
    std::printf("prune_ms %.6f\n", median_ms([&] {
      auto copy = std::make_unique<octomap::OcTree>(tree);
      copy->expand();
      return copy;
    }, [&](auto& copy) {
      copy->prune();
      nodes = copy->size();
    }));
    std::printf("pruned_nodes %zu\n", nodes);
  }
  {
    // writeBinary is maximum likelihood, prune and write.
    std::string bytes;
    std::printf("write_bt_ms %.6f\n", median_ms([&] { return std::make_unique<octomap::OcTree>(tree); }, [&](auto& copy) {
      std::ostringstream out;
      copy->writeBinary(out);
      bytes = out.str();
    }));
    std::ofstream(folder + "/map.bt", std::ios::binary) << bytes;
    std::unique_ptr<octomap::OcTree> read;
    std::printf("read_bt_ms %.6f\n", median_ms([&] {
      read.reset();
      return std::make_unique<std::istringstream>(bytes);
    }, [&](auto& in) {
      read = std::make_unique<octomap::OcTree>(tree.getResolution());
      read->readBinary(*in);
    }));
    read->write(folder + "/read_bt.ot");
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
