#include "palpate/contact/owners.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "palpate/base/for_each_index.h"

namespace palpate {
namespace {

constexpr std::int16_t kNoStructure = -1, kSeveral = -2;

std::uint64_t next_number() {
  static std::atomic<std::uint64_t> last{0};
  return ++last;
}

std::int16_t joined(std::int16_t a, std::int16_t b) {
  if (a == kNoStructure || a == b) return b;
  return b == kNoStructure ? a : kSeveral;
}

// calls body(i, j, k, structure) for every outer voxel of a slice
template <class Body>
void for_each_outer_voxel(const Bricks<LabelId>& labels, int k,
                          const std::vector<std::int16_t>& structure_of_label, const Body& body) {
  const auto is_unassigned = [&](LabelId label) { return structure_of_label[label] == kNoStructure; };
  const auto& faces = BrickLayout::kFaces;
  const auto visit_piece = [&](const RowPiece<LabelId>& piece) {
    if (piece.uniform) return;
    for (int i = 0; i < piece.count; ++i) {
      const LabelId* const voxel = piece.voxels + i;
      if (is_unassigned(*voxel)) continue;
      if (std::any_of(faces.begin(), faces.end(), [&](auto face) { return is_unassigned(voxel[face]); }))
        body(piece.i + i, piece.j, k, structure_of_label[*voxel]);
    }
  };
  for (int j = 0; j < labels.geometry().dims[1]; ++j) labels.for_each_piece(j, k, visit_piece);
}

// an outer voxel with its block
struct OuterVoxel {
  std::size_t block;
  std::int16_t structure;
  std::array<int, 3> index;
};

}  // namespace

Owners::Owners(const Bricks<LabelId>& labels, const std::vector<std::int16_t>& structure_of_label)
    : id_(next_number()),
      structure_of_label_(structure_of_label),
      spacing_mm_(labels.geometry().spacing_mm),
      reach_mm_(std::max(kReach_mm, 1.5 * spacing_mm_.maxCoeff())),
      X_VoxelPatient_(labels.geometry().X_PatientVoxel().inverse()),
      dims_(labels.geometry().dims) {
  PALPATE_CHECK(structure_of_label[labels.outside()] == kNoStructure);
  std::size_t count = 1;
  for (std::size_t a = 0; a < 3; ++a) {
    // a point is at most half a voxel from the centre of the voxel that determines its block
    block_[a] = static_cast<int>(std::ceil(reach_mm_ / spacing_mm_[static_cast<int>(a)] + 0.5));
    blocks_[a] = (dims_[a] + block_[a] - 1) / block_[a];
    count *= static_cast<std::size_t>(blocks_[a]);
  }

  // structures of each block; threads work on layers of blocks
  const int layers = blocks_[2], workers = worker_count(0, layers);
  single_structure_.assign(count, kNoStructure);
  std::vector<std::int16_t> any_of_layer(static_cast<std::size_t>(layers), kNoStructure);
  for_each_index(layers, workers, [&](int /*worker*/, int layer) {
    each_of_layer(labels, layer, [&](int i, int j, int k, std::int16_t structure) {
      std::int16_t& only = single_structure_[block_of(i, j, k)];
      only = joined(only, structure);
      any_of_layer[static_cast<std::size_t>(layer)] = structure;
    });
    return true;
  });
  for (const std::int16_t any : any_of_layer)
    if (any != kNoStructure) first_structure_ = any;
  PALPATE_CHECK(first_structure_ >= 0);
  spread(single_structure_, joined);

  // outer voxels of the blocks that a point with several structures in reach may need
  std::vector<std::uint8_t> is_visible(count);
  std::transform(single_structure_.begin(), single_structure_.end(), is_visible.begin(),
                 [](auto only) { return only == kSeveral; });
  spread(is_visible, [](std::uint8_t a, std::uint8_t b) { return static_cast<std::uint8_t>(a | b); });
  std::vector<std::vector<OuterVoxel>> of_layer(static_cast<std::size_t>(layers));
  for_each_index(layers, workers, [&](int /*worker*/, int layer) {
    std::vector<OuterVoxel>& voxels = of_layer[static_cast<std::size_t>(layer)];
    each_of_layer(labels, layer, [&](int i, int j, int k, std::int16_t structure) {
      const std::size_t block = block_of(i, j, k);
      if (is_visible[block] != 0) voxels.push_back({block, structure, {i, j, k}});
    });
    std::stable_sort(voxels.begin(), voxels.end(), [](const OuterVoxel& a, const OuterVoxel& b) {
      return std::pair(a.block, a.structure) < std::pair(b.block, b.structure);
    });
    return true;
  });
  first_run_of_block_.reserve(count + 1);
  for (const std::vector<OuterVoxel>& voxels : of_layer)
    for (auto next = voxels.begin(); next != voxels.end();) {
      first_run_of_block_.resize(next->block + 1, static_cast<std::uint32_t>(runs_.size()));
      const auto end = std::find_if(next, voxels.end(), [&](const OuterVoxel& voxel) {
        return voxel.block != next->block || voxel.structure != next->structure;
      });
      runs_.push_back({static_cast<std::uint32_t>(index_[0].size()), next->structure});
      for (; next != end; ++next)
        for (std::size_t a = 0; a < 3; ++a) index_[a].push_back(static_cast<float>(next->index[a]));
      while (index_[0].size() % kAtOnce != 0)
        for (std::vector<float>& index : index_) index.push_back(kFarAway);
    }
  first_run_of_block_.resize(count + 1, static_cast<std::uint32_t>(runs_.size()));
  runs_.push_back({static_cast<std::uint32_t>(index_[0].size()), kNoStructure});
}

template <class Body>
void Owners::each_of_layer(const Bricks<LabelId>& labels, int layer, const Body& body) const {
  const int end = std::min(dims_[2], (layer + 1) * block_[2]);
  for (int k = layer * block_[2]; k < end; ++k) for_each_outer_voxel(labels, k, structure_of_label_, body);
}

std::size_t Owners::block_of(int i, int j, int k) const {
  return (static_cast<std::size_t>(k / block_[2]) * static_cast<std::size_t>(blocks_[1]) +
          static_cast<std::size_t>(j / block_[1])) *
             static_cast<std::size_t>(blocks_[0]) +
         static_cast<std::size_t>(i / block_[0]);
}

// joins each block's value with those of its neighbours
template <class Value, class Join>
void Owners::spread(std::vector<Value>& of_block, const Join& join) const {
  std::size_t stride = 1;
  for (const int length : blocks_) {
    const std::size_t line = stride * static_cast<std::size_t>(length);
    const std::vector<Value> own = of_block;
    for (std::size_t begin = 0; begin < own.size(); begin += line)
      for (std::size_t b = begin; b + stride < begin + line; ++b) {
        of_block[b] = join(of_block[b], own[b + stride]);
        of_block[b + stride] = join(of_block[b + stride], own[b]);
      }
    stride = line;
  }
}

// sum of (1 - r^2 / R^2)^2 over a run's voxels within R of a point
double Owners::weight_of(std::size_t run, const std::array<float, 3>& point,
                         const std::array<float, 3>& per_reach) const {
  using Several = Eigen::Array<float, kAtOnce, 1>;
  Several all = Several::Zero();
  for (std::size_t n = runs_[run].begin; n < runs_[run + 1].begin; n += kAtOnce) {
    Several left = Several::Ones();
    for (std::size_t a = 0; a < 3; ++a) {
      const Several offset = (Eigen::Map<const Several>(index_[a].data() + n) - point[a]) * per_reach[a];
      left -= offset * offset;
    }
    const Several inside = left.max(0.0F);
    all += inside * inside;
  }
  double weight = 0;
  for (const float part : all) weight += static_cast<double>(part);
  return weight;
}

OwnerFractions Owners::at(const Point<Patient>& x) const {
  const Point<Voxel> p = X_VoxelPatient_ * x;
  std::array<int, 3> nearest{}, low{}, high{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double at = p[static_cast<int>(a)], voxels = reach_mm_ / spacing_mm_[static_cast<int>(a)];
    // not finite, or out of reach of all voxels
    if (!(at + voxels >= 0 && at - voxels <= dims_[a] - 1)) return OwnerFractions(first_structure_);
    nearest[a] = std::clamp(static_cast<int>(std::lround(at)), 0, dims_[a] - 1);
    low[a] = std::max(0, static_cast<int>(std::ceil(at - voxels))) / block_[a];
    high[a] = std::min(dims_[a] - 1, static_cast<int>(std::floor(at + voxels))) / block_[a];
  }
  const std::int16_t owner = single_structure_[block_of(nearest[0], nearest[1], nearest[2])];
  if (owner != kSeveral) return OwnerFractions(owner == kNoStructure ? first_structure_ : owner);

  OwnerFractions fractions;
  std::array<float, 3> point{}, per_reach{};  // as a fraction of the radius
  for (std::size_t a = 0; a < 3; ++a) {
    point[a] = static_cast<float>(p[static_cast<int>(a)]);
    per_reach[a] = static_cast<float>(spacing_mm_[static_cast<int>(a)] / reach_mm_);
  }
  const auto add = [&](std::int16_t structure, double weight) {
    std::size_t n = 0;
    while (n < fractions.count_ && fractions.fraction_[n].structure != structure) ++n;
    // structures beyond the capacity are ignored
    if (n == OwnerFractions::kCapacity) return;
    if (n == fractions.count_) fractions.fraction_[fractions.count_++] = {structure, 0};
    fractions.fraction_[n].fraction += weight;
  };
  for (int c = low[2]; c <= high[2]; ++c)
    for (int b = low[1]; b <= high[1]; ++b) {
      // blocks of a row are consecutive
      const std::size_t row =
          (static_cast<std::size_t>(c) * static_cast<std::size_t>(blocks_[1]) + static_cast<std::size_t>(b)) *
          static_cast<std::size_t>(blocks_[0]);
      const std::uint32_t end = first_run_of_block_[row + static_cast<std::size_t>(high[0]) + 1];
      for (std::uint32_t run = first_run_of_block_[row + static_cast<std::size_t>(low[0])]; run < end; ++run)
        if (const double weight = weight_of(run, point, per_reach); weight > 0)
          add(runs_[run].structure, weight);
    }
  return fractions.count_ > 0 ? in_order(fractions) : OwnerFractions(first_structure_);
}

OwnerFractions Owners::within(const Bricks<LabelId>& labels, const Point<Patient>& x) const {
  const Point<Voxel> p = X_VoxelPatient_ * x;
  std::array<int, 3> first{};
  for (std::size_t a = 0; a < 3; ++a) {
    const double at = p[static_cast<int>(a)];
    if (!(at >= 0 && at <= dims_[a] - 1)) return this->at(x);
    first[a] = std::min(static_cast<int>(at), std::max(0, dims_[a] - 2));
  }
  OwnerFractions fractions;
  for (int corner = 0; corner < 8; ++corner) {
    std::array<int, 3> voxel{};
    double weight = 1;
    for (std::size_t a = 0; a < 3; ++a) {
      const bool next = (corner >> a & 1) != 0;
      voxel[a] = first[a] + (next ? 1 : 0);
      const double beyond = p[static_cast<int>(a)] - first[a];
      weight *= next ? beyond : 1 - beyond;
    }
    const std::int16_t structure = structure_of_label_[labels.anywhere(voxel[0], voxel[1], voxel[2])];
    if (structure == kNoStructure || !(weight > 0)) continue;
    std::size_t n = 0;
    while (n < fractions.count_ && fractions.fraction_[n].structure != structure) ++n;
    if (n == fractions.count_) fractions.fraction_[fractions.count_++] = {structure, 0};
    fractions.fraction_[n].fraction += weight;
  }
  return fractions.count_ > 0 ? in_order(fractions) : at(x);
}

// normalises the shares and sorts them by decreasing size
OwnerFractions Owners::in_order(OwnerFractions fractions) {
  double all = 0;
  for (std::size_t n = 0; n < fractions.count_; ++n) all += fractions.fraction_[n].fraction;
  for (std::size_t n = 0; n < fractions.count_; ++n) fractions.fraction_[n].fraction /= all;
  std::sort(fractions.fraction_.begin(),
            fractions.fraction_.begin() + static_cast<std::ptrdiff_t>(fractions.count_),
            [](const OwnerFraction& a, const OwnerFraction& b) {
              return a.fraction > b.fraction || (a.fraction == b.fraction && a.structure < b.structure);
            });
  return fractions;
}

}  // namespace palpate
