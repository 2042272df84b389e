#include <algorithm>
#include <array>
#include <bit>
#include <limits>

#include "palpate/surfaces/surfaces.h"
#include "palpate/volume/slices.h"

namespace palpate {
namespace {

// neighbourhood of a joint: the voxels that meet at it and two more on every side
constexpr int kLateral = 2, kEdge = 2 * kLateral + 2;
// components of fewer voxels count as a pocket, not a side
constexpr int kSide_voxels = 9;

using Index = std::array<int, 3>;

/// Occupancy around a joint; the lowest of the joint's eight voxels is at the centre.
class Surroundings {
 public:
  Surroundings(const Bricks<LabelId>& labels, const std::vector<char>& is_touchable, const Index& at) {
    std::size_t n = 0;
    for (int k = -kLateral; k < kEdge - kLateral; ++k)
      for (int j = -kLateral; j < kEdge - kLateral; ++j)
        for (int i = -kLateral; i < kEdge - kLateral; ++i)
          free_[n++] = !is_touchable[labels.anywhere(at[0] + i, at[1] + j, at[2] + k)];
  }

  /// Whether two free voxels are on two sides of a sheet: at least half of the neighbourhood is free, and the
  /// two are not connected through faces.
  bool separates(const Index& one, const Index& other) {
    if (2 * std::count(free_.begin(), free_.end(), 0) > static_cast<std::ptrdiff_t>(free_.size()))
      return false;
    const int first = index_of(one), second = index_of(other);
    const int reached = fill(first, 1);
    return visited_[static_cast<std::size_t>(second)] == 0 && reached >= kSide_voxels &&
           fill(second, 2) >= kSide_voxels;
  }

 private:
  static int index_of(const Index& at) {
    return at[0] + kLateral + kEdge * (at[1] + kLateral + kEdge * (at[2] + kLateral));
  }

  // flood fill; returns the number of free voxels connected to one through faces
  int fill(int from, char mark) {
    std::array<int, kEdge * kEdge * kEdge> todo;
    std::size_t count = 0, done = 0;
    const auto observe = [&](int index) {
      const auto at = static_cast<std::size_t>(index);
      if (!free_[at] || visited_[at] != 0) return;
      visited_[at] = mark;
      todo[count++] = index;
    };
    observe(from);
    while (done < count) {
      const int node_index = todo[done++];
      const int i = node_index % kEdge, j = node_index / kEdge % kEdge, k = node_index / (kEdge * kEdge);
      if (i > 0) observe(node_index - 1);
      if (i + 1 < kEdge) observe(node_index + 1);
      if (j > 0) observe(node_index - kEdge);
      if (j + 1 < kEdge) observe(node_index + kEdge);
      if (k > 0) observe(node_index - kEdge * kEdge);
      if (k + 1 < kEdge) observe(node_index + kEdge * kEdge);
    }
    return static_cast<int>(count);
  }

  std::array<char, kEdge * kEdge * kEdge> free_{}, visited_{};
};

struct JointCount {
  std::size_t joints = 0, first = std::numeric_limits<std::size_t>::max();
  Point<Patient> position;  // position of the first joint in memory order, independent of threads

  void add(const JointCount& other) {
    joints += other.joints;
    if (other.first < first) position = other.position;
    first = std::min(first, other.first);
  }
};
using JointCounts = std::vector<JointCount>;

// Two free voxels that meet at an edge or a corner of a block of up to eight; the others are touchable.
struct Joint {
  Index one, other, size;
};
constexpr std::array<Joint, 10> kJoints{{{{0, 0, 0}, {1, 1, 0}, {2, 2, 1}},
                                         {{1, 0, 0}, {0, 1, 0}, {2, 2, 1}},
                                         {{0, 0, 0}, {1, 0, 1}, {2, 1, 2}},
                                         {{1, 0, 0}, {0, 0, 1}, {2, 1, 2}},
                                         {{0, 0, 0}, {0, 1, 1}, {1, 2, 2}},
                                         {{0, 1, 0}, {0, 0, 1}, {1, 2, 2}},
                                         {{0, 0, 0}, {1, 1, 1}, {2, 2, 2}},
                                         {{1, 0, 0}, {0, 1, 1}, {2, 2, 2}},
                                         {{0, 1, 0}, {1, 0, 1}, {2, 2, 2}},
                                         {{1, 1, 0}, {0, 0, 1}, {2, 2, 2}}}};

// bit of a block's voxel (i, j, k): i + 2 j + 4 k
constexpr unsigned bit(const Index& at) {
  return 1u << (at[0] + 2 * at[1] + 4 * at[2]);
}

struct Pattern {
  unsigned inspected = 0, solid = 0;
};
constexpr std::array<Pattern, kJoints.size()> patterns() {
  std::array<Pattern, kJoints.size()> all;
  for (std::size_t n = 0; n < kJoints.size(); ++n) {
    for (int c = 0; c < 8; ++c) {
      const Index at{c & 1, c >> 1 & 1, c >> 2};
      const Index& size = kJoints[n].size;
      if (at[0] < size[0] && at[1] < size[1] && at[2] < size[2]) all[n].inspected |= bit(at);
    }
    all[n].solid = all[n].inspected & ~bit(kJoints[n].one) & ~bit(kJoints[n].other);
  }
  return all;
}
constexpr std::array<Pattern, kJoints.size()> kPatterns = patterns();

// for each combination of touchable voxels in a block: whether it contains a joint
constexpr std::array<bool, 256> joint_blocks() {
  std::array<bool, 256> any{};
  for (unsigned block = 0; block < 256; ++block)
    for (const Pattern& pattern : kPatterns)
      any[block] = any[block] || (block & pattern.inspected) == pattern.solid;
  return any;
}
constexpr std::array<bool, 256> kJointBlocks = joint_blocks();

// examines the joints of one block
void inspect(const Bricks<LabelId>& labels, const std::vector<char>& is_touchable, const Index& at,
             unsigned block, JointCounts& found) {
  for (std::size_t n = 0; n < kJoints.size(); ++n) {
    if ((block & kPatterns[n].inspected) != kPatterns[n].solid) continue;
    const auto label_of = [&](int corner) {
      return labels.at(at[0] + (corner & 1), at[1] + (corner >> 1 & 1), at[2] + (corner >> 2));
    };
    const LabelId label = label_of(std::countr_zero(kPatterns[n].solid));
    bool one_structure = true;
    for (int corner = 0; corner < 8; ++corner)
      if ((kPatterns[n].solid >> corner & 1) != 0) one_structure = one_structure && label_of(corner) == label;
    if (!one_structure) continue;
    Surroundings around(labels, is_touchable, at);
    if (!around.separates(kJoints[n].one, kJoints[n].other)) continue;
    const Index& size = kJoints[n].size;
    const Point<Voxel> centre(at[0] + 0.5 * (size[0] - 1), at[1] + 0.5 * (size[1] - 1),
                              at[2] + 0.5 * (size[2] - 1));
    found[label].add(
        {1, labels.geometry().offset(at[0], at[1], at[2]), labels.geometry().X_PatientVoxel() * centre});
  }
}

}  // namespace

Result<std::vector<Leaks>> find_leaks(const Bricks<LabelId>& labels, const std::vector<LabelId>& structures,
                                      int threads, const Progress& progress) {
  std::vector<char> is_touchable(std::size_t{std::numeric_limits<LabelId>::max()} + 1, 0);
  for (const LabelId structure : structures) is_touchable[structure] = 1;
  const auto& dims = labels.geometry().dims;
  if (dims[0] < 2 || dims[1] < 2) return std::vector<Leaks>();
  const int workers = worker_count(threads, dims[2]);
  std::vector<JointCounts> found(static_cast<std::size_t>(workers), JointCounts(is_touchable.size()));
  const auto done =
      internal::for_each_slice(dims[2], workers, progress, {"looking for leaks"}, [&](int worker, int k) {
        const auto scan_along = [&](const RowPiece<LabelId>& piece) {
          if (piece.uniform) return;
          // beyond the last slice no voxel is touchable
          const auto column = [&](int i) {
            unsigned bits = 0;
            for (int r = 0; r < 4; ++r)
              if (is_touchable[piece.voxels[i + (r & 1) * BrickLayout::kRow +
                                            (r >> 1) * BrickLayout::kSlice]] != 0)
                bits |= 1u << (2 * r);
            return bits;
          };
          const int count = std::min(piece.count, dims[0] - 1 - piece.i);
          unsigned before = column(0);
          for (int i = 0; i < count; ++i) {
            const unsigned next = column(i + 1), block = before | next << 1;
            before = next;
            if (kJointBlocks[block])
              inspect(labels, is_touchable, {piece.i + i, piece.j, k}, block,
                      found[static_cast<std::size_t>(worker)]);
          }
        };
        for (int j = 0; j + 1 < dims[1]; ++j) labels.for_each_piece(j, k, scan_along);
      });
  if (!done) return done.error();
  std::vector<Leaks> leaky;
  for (const LabelId structure : structures) {
    JointCount total;
    for (const JointCounts& of_worker : found) total.add(of_worker[structure]);
    if (total.joints > 0) leaky.push_back({structure, total.joints, total.position});
  }
  return leaky;
}

}  // namespace palpate
