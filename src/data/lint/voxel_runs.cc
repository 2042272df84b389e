#include "lint/voxel_runs.h"

#include <algorithm>

#include "palpate/base/disjoint_sets.h"

namespace palpate::internal {
namespace {

// Joins runs of equal value that touch across two rows. Labels touch by faces, edges and corners; background
// only by faces, which the rows share if `faces_share_row`.
void join_touching(std::span<const VoxelRun> now, std::span<const VoxelRun> before, bool faces_share_row,
                   DisjointSets& sets) {
  std::size_t begin = 0;
  for (const VoxelRun& run : now) {
    while (begin < before.size() && before[begin].last < run.first - 1) ++begin;
    for (std::size_t b = begin; b < before.size() && before[b].first <= run.last + 1; ++b) {
      const VoxelRun& other = before[b];
      if (other.value != run.value) continue;
      const bool overlaps = other.first <= run.last && run.first <= other.last;
      if (run.value != 0 || (faces_share_row && overlaps)) sets.join(run.node, other.node);
    }
  }
}

constexpr int kSlabSlices = 16;

/// Tests for uniform 2 x 2 x 2 cubes between two slices, and for uniform 2 x 2 squares within a slice.
class Cubes {
 public:
  explicit Cubes(const Volume<LabelId>& labels)
      : labels_(labels),
        nx_(labels.geometry().dims[0]),
        ny_(labels.geometry().dims[1]),
        nz_(labels.geometry().dims[2]) {}

  std::size_t size() const { return static_cast<std::size_t>(nx_ + 1) * static_cast<std::size_t>(ny_ + 1); }

  const LabelId* row(int j, int k) const {
    j = std::clamp(j, 0, ny_ - 1);
    k = std::clamp(k, 0, nz_ - 1);
    return labels_.voxels().data() + labels_.geometry().offset(0, j, k);
  }

  // For each square with corners (i, j) ... (i + 1, j + 1) of slice k, with i and j from -1, whether its
  // voxels are equal; in row order.
  void squares(int k, std::vector<std::uint8_t>& out) const {
    for (int j = -1; j < ny_; ++j) {
      const LabelId *a = row(j, k), *b = row(j + 1, k);
      std::uint8_t* to = out.data() + static_cast<std::size_t>(j + 1) * static_cast<std::size_t>(nx_ + 1);
      to[0] = a[0] == b[0];
      for (int i = 0; i + 1 < nx_; ++i)
        to[i + 1] = static_cast<std::uint8_t>((a[i] == b[i]) & (a[i + 1] == b[i + 1]) & (a[i] == a[i + 1]));
      to[nx_] = a[nx_ - 1] == b[nx_ - 1];
    }
  }

  // For each cube between slices k and k + 1, whether its voxels are equal; from the squares of both slices.
  void cubes(int k, const std::vector<std::uint8_t>& below, const std::vector<std::uint8_t>& above,
             std::vector<std::uint8_t>& out) const {
    for (int j = -1; j < ny_; ++j) {
      const LabelId *a = row(j, k), *b = row(j, k + 1);
      const std::size_t at = static_cast<std::size_t>(j + 1) * static_cast<std::size_t>(nx_ + 1);
      const std::uint8_t *one = below.data() + at, *two = above.data() + at;
      std::uint8_t* to = out.data() + at;
      to[0] = static_cast<std::uint8_t>(one[0] & two[0] & (a[0] == b[0]));
      for (int i = 0; i < nx_; ++i)
        to[i + 1] = static_cast<std::uint8_t>(one[i + 1] & two[i + 1] & (a[i] == b[i]));
    }
  }

 private:
  const Volume<LabelId>& labels_;
  int nx_, ny_, nz_;
};

}  // namespace

const VoxelRun* RunVolume::find(int i, int j, int k) const {
  const auto runs = row(j, k);
  const auto after =
      std::upper_bound(runs.begin(), runs.end(), i, [](int x, const VoxelRun& run) { return x < run.first; });
  if (after == runs.begin()) return nullptr;
  const VoxelRun& run = *std::prev(after);
  return i <= run.last ? &run : nullptr;
}

void RunVolume::append_row(int k, const LabelId* values, const std::uint8_t* mask) {
  Slice& slice = slices_[static_cast<std::size_t>(k)];
  for (int i = 0; i < dims_[0];) {
    if (mask != nullptr && mask[i] == 0) {
      ++i;
      continue;
    }
    int end = i + 1;
    while (end < dims_[0] && values[end] == values[i] && (mask == nullptr || mask[end] != 0)) ++end;
    slice.runs.push_back({i, end - 1, values[i]});
    i = end;
  }
  slice.row_start.push_back(slice.runs.size());
}

Result<RunVolume> runs_of(const Volume<LabelId>& labels, int workers, const Progress& progress,
                          const ProgressSpan& span) {
  const GridGeometry& grid = labels.geometry();
  RunVolume runs(grid.dims);
  const auto done = for_each_slice(grid.dims[2], workers, progress, span, [&](int, int k) {
    for (int j = 0; j < grid.dims[1]; ++j)
      runs.append_row(k, labels.voxels().data() + grid.offset(0, j, k), nullptr);
  });
  if (!done) return done.error();
  return runs;
}

std::vector<Component> connect(RunVolume& runs) {
  DisjointSets sets;
  const auto& dims = runs.dims();
  for (int k = 0; k < dims[2]; ++k)
    for (VoxelRun& run : runs.slice(k)) run.node = sets.add();
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j) {
      const auto now = runs.row(j, k);
      join_touching(now, runs.row(j - 1, k), true, sets);
      join_touching(now, runs.row(j - 1, k - 1), false, sets);
      join_touching(now, runs.row(j, k - 1), true, sets);
      join_touching(now, runs.row(j + 1, k - 1), false, sets);
    }

  std::vector<Component> components;
  constexpr std::uint32_t kNone = 0xffffffff;
  std::vector<std::uint32_t> component_of_root(sets.size(), kNone);
  for (int k = 0; k < dims[2]; ++k) {
    std::size_t n = 0;
    const auto slice = runs.slice(k);
    for (int j = 0; j < dims[1]; ++j)
      for (const std::size_t end = n + runs.row(j, k).size(); n < end; ++n) {
        VoxelRun& run = slice[n];
        std::uint32_t& number = component_of_root[sets.root(run.node)];
        if (number == kNone) {
          number = static_cast<std::uint32_t>(components.size());
          components.push_back({run.value, 0, {run.first, j, k}, {run.first, j, k}, {run.last, j, k}});
        }
        run.node = number;
        Component& component = components[number];
        component.voxels += static_cast<std::size_t>(run.length());
        component.box_min = {std::min(component.box_min[0], run.first), std::min(component.box_min[1], j),
                             std::min(component.box_min[2], k)};
        component.box_max = {std::max(component.box_max[0], run.last), std::max(component.box_max[1], j),
                             std::max(component.box_max[2], k)};
      }
  }
  for (Component& component : components)
    for (std::size_t a = 0; a < 3; ++a)
      component.at_border =
          component.at_border || component.box_min[a] == 0 || component.box_max[a] == dims[a] - 1;
  return components;
}

Result<CubeMorphology> cube_morphology(const Volume<LabelId>& labels, int workers, const Progress& progress,
                                       const ProgressSpan& span) {
  const auto& dims = labels.geometry().dims;
  CubeMorphology out{RunVolume(dims), RunVolume(dims)};
  const Cubes cubes(labels);
  struct Scratch {
    std::vector<std::uint8_t> squares_below, squares_above, cubes_below, cubes_above, thin, inner;
  };
  std::vector<Scratch> scratch(static_cast<std::size_t>(workers));
  const auto width = static_cast<std::size_t>(dims[0] + 1);
  const int slabs = (dims[2] + kSlabSlices - 1) / kSlabSlices;
  const auto done = for_each_slice(slabs, workers, progress, span, [&](int worker, int slab) {
    Scratch& s = scratch[static_cast<std::size_t>(worker)];
    for (auto* bytes : {&s.squares_below, &s.squares_above, &s.cubes_below, &s.cubes_above})
      bytes->resize(cubes.size());
    s.thin.resize(static_cast<std::size_t>(dims[0]));
    s.inner.resize(static_cast<std::size_t>(dims[0]));
    const int first = slab * kSlabSlices, end = std::min(dims[2], first + kSlabSlices);
    cubes.squares(first - 1, s.squares_below);
    cubes.squares(first, s.squares_above);
    cubes.cubes(first - 1, s.squares_below, s.squares_above, s.cubes_below);
    for (int k = first; k < end; ++k) {
      std::swap(s.squares_below, s.squares_above);
      cubes.squares(k + 1, s.squares_above);
      cubes.cubes(k, s.squares_below, s.squares_above, s.cubes_above);
      for (int j = 0; j < dims[1]; ++j) {
        const std::size_t at = static_cast<std::size_t>(j) * width;
        const std::uint8_t *a = s.cubes_below.data() + at, *b = a + width, *c = s.cubes_above.data() + at,
                           *d = c + width;
        const LabelId* values = cubes.row(j, k);
        for (int i = 0; i < dims[0]; ++i) {
          const auto any = static_cast<std::uint8_t>(a[i] | a[i + 1] | b[i] | b[i + 1] | c[i] | c[i + 1] |
                                                     d[i] | d[i + 1]);
          s.inner[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>(a[i] & a[i + 1] & b[i] & b[i + 1] &
                                                                           c[i] & c[i + 1] & d[i] & d[i + 1]);
          s.thin[static_cast<std::size_t>(i)] = static_cast<std::uint8_t>((any ^ 1) & (values[i] != 0));
        }
        out.thin.append_row(k, values, s.thin.data());
        out.inner.append_row(k, values, s.inner.data());
      }
      std::swap(s.cubes_below, s.cubes_above);
    }
  });
  if (!done) return done.error();
  return out;
}

}  // namespace palpate::internal
