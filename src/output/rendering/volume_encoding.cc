#include "rendering/volume_encoding.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>

#include "palpate/base/for_each_index.h"
#include "palpate/volume/gaussian_kernel.h"
#include "palpate/volume/gaussian_rows.h"
#include "rendering/volume_terms.h"

namespace palpate::internal::volume_picture {

/// Dense array over a box, i fastest.
template <class T>
struct Box {
  explicit Box(const std::array<int, 3>& box_size) : size(box_size) {
    values.resize(static_cast<std::size_t>(size[0]) * size[1] * size[2]);
  }
  std::size_t offset(int i, int j, int k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(size[0]) *
               (static_cast<std::size_t>(j) +
                static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(k));
  }
  T* row(int j, int k) { return values.data() + offset(0, j, k); }
  const T* row(int j, int k) const { return values.data() + offset(0, j, k); }

  std::array<int, 3> size;
  std::vector<T> values;
};

/// Appearance of a voxel that belongs to one structure entirely, and components of mixtures.
struct StructureOptics {
  float opacity = 0;
  float solid = 0;    ///< In units of h / mm
  float surface = 0;  ///< Optical depth
  float haze = 0;     ///< In units of h / mm
  Rgb colour;
};

struct VoxelAppearance {
  float extinction = 0;  ///< In units of h / mm
  float colour[3] = {};
  float covered = 0;  ///< Coverage by structures that are drawn
};

namespace {

constexpr int kTileSide = 64;
/// Usual number of blocks per tile, to avoid reallocation while they are collected.
constexpr std::size_t kUsualBlocks = 16384;

/// Gaussian convolved with [1 2 1] / 4, one side.
std::vector<float> smoothing_kernel(double sigma_voxels) {
  const std::vector<float> gaussian = sample_normal_kernel(sigma_voxels).weights;
  const auto at = [&](int t) {
    const auto n = static_cast<std::size_t>(std::abs(t));
    return n < gaussian.size() ? gaussian[n] : 0.0f;
  };
  std::vector<float> kernel;
  for (int t = 0; t <= static_cast<int>(gaussian.size()); ++t)
    kernel.push_back(0.25f * at(t - 1) + 0.5f * at(t) + 0.25f * at(t + 1));
  return kernel;
}

std::int8_t rounded(double value) {
  return static_cast<std::int8_t>(value < 0 ? value - 0.5 : value + 0.5);
}

/// Rows of values, with a flag for rows known to be constant.
struct KnownRows {
  explicit KnownRows(const std::array<int, 3>& size)
      : values(size), is_constant(static_cast<std::size_t>(size[1]) * static_cast<std::size_t>(size[2])) {}
  char& constant(int j, int k) { return is_constant[row_number(j, k)]; }
  /// Whether rows j - reach * dj ... j + reach * dj are constant, and correspondingly along k.
  bool are_constant(int j, int k, int dj, int dk, int reach) const {
    for (int t = -reach; t <= reach; ++t)
      if (!is_constant[row_number(j + t * dj, k + t * dk)]) return false;
    return true;
  }
  std::size_t row_number(int j, int k) const {
    return static_cast<std::size_t>(j) +
           static_cast<std::size_t>(values.size[1]) * static_cast<std::size_t>(k);
  }

  Box<float> values;
  std::vector<char> is_constant;
};

/// Weighted sums of neighbouring rows by a symmetric kernel.
class KernelSum {
 public:
  /// @param step  distance between rows
  KernelSum(const std::vector<float>& kernel, std::size_t step)
      : kernel_(kernel), step_(step), pairs_(kernel.size() - 1) {}
  /// @param constant  all sums of the row are equal: one is computed, by the same operations
  void sum(const float* centre, int length, bool constant, float* out) {
    const auto count = static_cast<std::size_t>(length);
    for (std::size_t t = 1; t <= pairs_.size(); ++t)
      pairs_[t - 1] = {centre - t * step_, centre + t * step_, kernel_[t]};
    sum_rows({centre, kernel_[0], pairs_.data(), pairs_.size()}, constant ? 1 : count, out);
    if (constant) std::fill_n(out + 1, count - 1, out[0]);
  }

 private:
  const std::vector<float>& kernel_;
  std::size_t step_;
  std::vector<RowPair<float>> pairs_;
};

/// Smooths values of labels along all axes; the result is smaller by the kernels' reach on either side.
/// Processes plane after plane across j along k, then slice after slice along i and j, so that each fits in a
/// core's cache.
/// @param value  by label; the last entry applies to all labels beyond
Box<float> smoothed(const Box<LabelId>& labels, const std::vector<float>& value,
                    const std::array<std::vector<float>, 3>& kernels) {
  const std::array<int, 3>& from = labels.size;
  std::array<int, 3> reach{}, to{};
  for (std::size_t a = 0; a < 3; ++a) {
    reach[a] = static_cast<int>(kernels[a].size()) - 1;
    to[a] = from[a] - 2 * reach[a];
  }
  const auto width = static_cast<std::size_t>(from[0]);
  KnownRows plane({from[0], 1, from[2]}), along_k({from[0], from[1], to[2]}), slice({to[0], from[1], 1});
  KernelSum by_k(kernels[2], width), by_i(kernels[0], 1), by_j(kernels[1], static_cast<std::size_t>(to[0]));
  for (int j = 0; j < from[1]; ++j) {
    for (int k = 0; k < from[2]; ++k) {
      const LabelId* row = labels.row(j, k);
      float* values = plane.values.row(0, k);
      for (std::size_t i = 0; i < width; ++i)
        values[i] = value[std::min<std::size_t>(row[i], value.size() - 1)];
      plane.constant(0, k) = std::all_of(values, values + width, [&](float v) { return v == values[0]; });
    }
    for (int k = 0; k < to[2]; ++k) {
      const bool constant = plane.are_constant(0, k + reach[2], 0, 1, reach[2]);
      by_k.sum(plane.values.row(0, k + reach[2]), from[0], constant, along_k.values.row(j, k));
      along_k.constant(j, k) = constant;
    }
  }
  Box<float> all(to);
  for (int k = 0; k < to[2]; ++k) {
    for (int j = 0; j < from[1]; ++j) {
      const bool constant = along_k.constant(j, k);
      by_i.sum(along_k.values.row(j, k) + reach[0], to[0], constant, slice.values.row(j, 0));
      slice.constant(j, 0) = constant;
    }
    for (int j = 0; j < to[1]; ++j)
      by_j.sum(slice.values.row(j + reach[1], 0), to[0], slice.are_constant(j + reach[1], 0, 1, 0, reach[1]),
               all.row(j, k));
  }
  return all;
}

}  // namespace

// ---- a tile -----------------------------------------------------------------------------------------------

/// A box of voxels, with all data that determine their appearance.
class VolumeEncoding::Tile {
 public:
  /// @param changed  voxels whose appearance differs from the stored blocks
  /// @param renormalised   voxels whose normals may differ; includes `changed`
  Tile(const VolumeEncoding& encoding, const Bricks<LabelId>& labels, const VoxelBox& box,
       const VoxelBox& changed, const VoxelBox& renormalised)
      : encoding_(encoding),
        box_(box),
        changed_(within(box, changed)),
        renormalised_(within(box, renormalised)),
        margin_(margins(encoding)),
        labels_(widened(renormalised_, margin_)) {
    copy_labels(labels);
    for (const StructureAppearance& appearance : encoding.appearances_)
      optics_.push_back(optics_of(appearance));
    optics_.resize(std::max<std::size_t>(1, optics_.size()));
    optics_[0] = {};
    for (const StructureOptics& optics : optics_) opacities_.push_back(optics.opacity);
    // for labels without an appearance
    opacities_.push_back(optics_[0].opacity);
  }
  static std::array<int, 3> margins(const VolumeEncoding& encoding) {
    std::array<int, 3> margin{};
    // central difference of the smoothed values
    for (std::size_t a = 0; a < 3; ++a) margin[a] = static_cast<int>(encoding.kernels_[a].size());
    return margin;
  }

  /// Calls put(rows, i, j, k, block) for every block of either kind of rows that may have changed.
  template <class Put>
  void for_each_block(const Put& put) {
    const LabelId first = labels_.values.front();
    const bool uniform = std::all_of(labels_.values.begin(), labels_.values.end(),
                                     [&](LabelId label) { return label == first; });
    const std::array<int, 3>& size = box_.size;
    appearances_.assign(static_cast<std::size_t>(size[0]) * size[1] * size[2], {});
    // padding, since a block at the end is read completely
    for (auto& rows : normals_)
      for (auto& component : rows) component.assign(appearances_.size() + kBlock, 0);
    if (uniform)
      fill_appearances(appearance_of_one(optics(first)));
    else
      find_appearances();
    if (!is_all_changed()) load_unchanged_extinction();
    if (!uniform) find_normals();
    if (encoding_.scan_.scan != nullptr) add_scan();
    for (int along = 0; along < 2; ++along) {
      const auto a = static_cast<std::size_t>(along), across = 1 - a;
      for (int k = renormalised_[2][0]; k < renormalised_[2][1]; ++k)
        for (int c = renormalised_[across][0]; c < renormalised_[across][1]; ++c) {
          // voxels of the row whose appearance has changed
          const bool is_in = is_changed(across, c) && is_changed(2, k);
          const std::array<int, 2> changed = is_in ? changed_[a] : std::array{0, 0};
          const BlockRows::Row row = encoding_.rows_[a].row(box_.first[across] + c, box_.first[2] + k);
          for (int b = 0; b < size[a]; b += kBlock) {
            const std::array<int, 3> at{box_.first[0] + (along == 0 ? b : c),
                                        box_.first[1] + (along == 0 ? c : b), box_.first[2] + k};
            const int end = std::min(b + kBlock, size[a]), from = std::max(b, changed[0]),
                      to = std::min(end, changed[1]);
            const bool is_whole = from == b && to == end;
            const VoxelBlock* before = is_whole ? nullptr : row[(box_.first[a] + b) / kBlock];
            if (before == nullptr && from >= to) continue;
            const NormalWords normals = normal_words(a, at, std::max(b, renormalised_[a][0]) - b,
                                                     std::min(end, renormalised_[a][1]) - b);
            if (from >= to && normals.are_of(*before)) continue;
            VoxelBlock block{};
            if (before != nullptr) block = *before;
            const std::size_t first_voxel = offset(at[0] - box_.first[0], at[1] - box_.first[1], k),
                              step = along == 0 ? 1 : static_cast<std::size_t>(size[0]);
            for (int n = from; n < to; ++n)
              fill_appearance(block, n - b, first_voxel + static_cast<std::size_t>(n - b) * step);
            normals.write_into(block);
            put(along, at[0], at[1], at[2], block);
          }
        }
    }
  }

 private:
  using Region = std::array<std::array<int, 2>, 3>;  ///< First and end relative to the box's first voxel

  static Region within(const VoxelBox& box, const VoxelBox& part) {
    Region region;
    for (std::size_t a = 0; a < 3; ++a) {
      region[a][0] = std::clamp(part.first[a] - box.first[a], 0, box.size[a]);
      region[a][1] = std::clamp(part.first[a] + part.size[a] - box.first[a], region[a][0], box.size[a]);
    }
    return region;
  }
  static std::array<int, 3> widened(const Region& region, const std::array<int, 3>& margin) {
    std::array<int, 3> size{};
    for (std::size_t a = 0; a < 3; ++a) size[a] = region[a][1] - region[a][0] + 2 * margin[a];
    return size;
  }
  StructureOptics optics_of(const StructureAppearance& appearance) const {
    const double h = encoding_.grid_.min_spacing_mm();
    StructureOptics optics;
    optics.opacity = static_cast<float>(appearance.opacity);
    optics.colour = appearance.colour;
    if (appearance.opacity >= 1) {
      optics.solid = static_cast<float>(kSolidDepth);
    } else if (appearance.opacity > 0) {
      optics.surface = static_cast<float>(surface_depth(appearance.opacity));
      optics.haze = static_cast<float>(haze_per_mm(appearance.opacity) * h);
    }
    return optics;
  }
  const StructureOptics& optics(LabelId label) const { return optics_[label < optics_.size() ? label : 0]; }
  std::size_t offset(int i, int j, int k) const {
    return static_cast<std::size_t>(i) +
           static_cast<std::size_t>(box_.size[0]) *
               (static_cast<std::size_t>(j) +
                static_cast<std::size_t>(box_.size[1]) * static_cast<std::size_t>(k));
  }

  void copy_labels(const Bricks<LabelId>& labels) {
    const std::array<int, 3>& dims = encoding_.grid_.dims;
    std::array<int, 3> first{};
    for (std::size_t a = 0; a < 3; ++a) first[a] = box_.first[a] + renormalised_[a][0] - margin_[a];
    const int from = std::max(0, first[0]), to = std::min(dims[0], first[0] + labels_.size[0]);
    for (int k = 0; k < labels_.size[2]; ++k)
      for (int j = 0; j < labels_.size[1]; ++j) {
        const int jj = first[1] + j, kk = first[2] + k;
        if (jj < 0 || kk < 0 || jj >= dims[1] || kk >= dims[2]) continue;
        labels.copy_row(from, jj, kk, to - from, labels_.row(j, k) + (from - first[0]));
      }
  }
  /// @return labels of a row, from `first_label()` on
  const LabelId* label_row(int j, int k) const {
    return labels_.row(j - renormalised_[1][0] + margin_[1], k - renormalised_[2][0] + margin_[2]);
  }
  int first_label() const { return renormalised_[0][0] - margin_[0]; }

  static VoxelAppearance appearance_of_one(const StructureOptics& optics) {
    const Rgb& c = optics.colour;
    return {
        optics.solid + optics.haze, {1.0f * c.r, 1.0f * c.g, 1.0f * c.b}, optics.opacity > 0 ? 1.0f : 0.0f};
  }

  bool is_changed(std::size_t axis, int n) const { return n >= changed_[axis][0] && n < changed_[axis][1]; }
  bool is_all_changed() const {
    for (std::size_t a = 0; a < 3; ++a)
      if (changed_[a] != std::array{0, box_.size[a]}) return false;
    return true;
  }

  void fill_appearances(const VoxelAppearance& appearance) {
    for (int k = changed_[2][0]; k < changed_[2][1]; ++k)
      for (int j = changed_[1][0]; j < changed_[1][1]; ++j)
        for (int i = changed_[0][0]; i < changed_[0][1]; ++i) appearances_[offset(i, j, k)] = appearance;
  }

  /// Marks the voxels with an unchanged appearance that are not empty, as find_normals() needs it.
  void load_unchanged_extinction() {
    for (int k = renormalised_[2][0]; k < renormalised_[2][1]; ++k)
      for (int j = renormalised_[1][0]; j < renormalised_[1][1]; ++j) {
        const bool is_in = is_changed(1, j) && is_changed(2, k);
        const BlockRows::Row row = encoding_.rows_[0].row(box_.first[1] + j, box_.first[2] + k);
        for (int b = 0; b < box_.size[0]; b += kBlock) {
          const VoxelBlock* before = row[(box_.first[0] + b) / kBlock];
          if (before == nullptr) continue;
          for (int i = b; i < std::min(b + kBlock, box_.size[0]); ++i)
            if (!is_in || !is_changed(0, i))
              appearances_[offset(i, j, k)].extinction = before->extinction[i - b];
        }
      }
  }

  void find_appearances() {
    constexpr std::uint32_t kSeveral = 0x10000;
    const std::array<int, 2>& along = changed_[0];
    std::vector<std::uint32_t> column(static_cast<std::size_t>(box_.size[0]) + 2);
    for (int k = changed_[2][0]; k < changed_[2][1]; ++k)
      for (int j = changed_[1][0]; j < changed_[1][1]; ++j) {
        // common label of the nine voxels across a position of the row
        const LabelId* rows[9];
        for (int r = 0; r < 9; ++r) rows[r] = label_row(j + r % 3 - 1, k + r / 3 - 1);
        const int first = first_label();
        for (int i = along[0] - 1; i <= along[1]; ++i) {
          std::uint32_t label = rows[0][i - first];
          for (int r = 1; r < 9; ++r) label = rows[r][i - first] == label ? label : kSeveral;
          column[static_cast<std::size_t>(i + 1)] = label;
        }
        VoxelAppearance* appearance = appearances_.data() + offset(0, j, k);
        for (int i = along[0]; i < along[1]; ++i) {
          const std::uint32_t* c = column.data() + i;
          const bool one = c[0] == c[1] && c[1] == c[2] && c[1] != kSeveral;
          appearance[i] =
              one ? appearance_of_one(optics(static_cast<LabelId>(c[1]))) : mixture(rows, i - first);
        }
      }
  }

  /// Appearance of a voxel from the 27 voxels around it.
  VoxelAppearance mixture(const LabelId* const* rows, int i) const {
    struct Fraction {
      LabelId label;
      float coverage;
    };
    std::array<Fraction, 27> fractions;
    std::size_t label_count = 0;
    Eigen::Vector3d slope = Eigen::Vector3d::Zero();
    for (int r = 0; r < 9; ++r)
      for (int a = -1; a <= 1; ++a) {
        const LabelId label = rows[r][i + a];
        if (optics(label).opacity == 0) continue;
        const int b = r % 3 - 1, c = r / 3 - 1;
        const double wa = a == 0 ? 0.5 : 0.25, wb = b == 0 ? 0.5 : 0.25, wc = c == 0 ? 0.5 : 0.25;
        std::size_t n = 0;
        while (n < label_count && fractions[n].label != label) ++n;
        if (n == label_count) fractions[label_count++] = {label, 0};
        fractions[n].coverage += static_cast<float>(wa * wb * wc);
        slope += 0.5 * Eigen::Vector3d(a * wb * wc, b * wa * wc, c * wa * wb);
      }
    VoxelAppearance appearance;
    if (label_count == 0) return appearance;
    float all = 0, solid = 0;
    for (std::size_t n = 0; n < label_count; ++n) {
      all += fractions[n].coverage;
      if (optics(fractions[n].label).solid > 0) solid += fractions[n].coverage;
    }
    appearance.covered = all;
    const auto solidity = static_cast<float>(volume_picture::solidity(solid, optics(rows[4][i]).solid > 0));
    const auto steep =
        static_cast<float>((encoding_.to_patient_ * slope).norm() * encoding_.grid_.min_spacing_mm());
    for (std::size_t n = 0; n < label_count; ++n) {
      const StructureOptics& p = optics(fractions[n].label);
      const float e = p.solid > 0 ? fractions[n].coverage * p.solid * solidity / solid
                                  : fractions[n].coverage * (p.haze + p.surface * steep / all);
      appearance.extinction += e;
      appearance.colour[0] += e * p.colour.r;
      appearance.colour[1] += e * p.colour.g;
      appearance.colour[2] += e * p.colour.b;
    }
    if (appearance.extinction > 0)
      for (float& c : appearance.colour) c /= appearance.extinction;
    return appearance;
  }

  void add_scan() {
    const ScanAppearance& scan = encoding_.scan_;
    const double h = encoding_.grid_.min_spacing_mm();
    for (int k = 0; k < box_.size[2]; ++k)
      for (int j = 0; j < box_.size[1]; ++j) {
        const float* scanned = &scan.scan->at(box_.first[0], box_.first[1] + j, box_.first[2] + k);
        VoxelAppearance* appearance = appearances_.data() + offset(0, j, k);
        for (int i = 0; i < box_.size[0]; ++i) {
          const double value = value_in_window(scanned[i], scan.window);
          const auto e = static_cast<float>(scan_per_mm(value, appearance[i].covered, scan.opacity) * h);
          if (e == 0) continue;
          const auto grey = static_cast<float>(scan_grey(value));
          const float all = appearance[i].extinction + e;
          for (float& c : appearance[i].colour) c = (c * appearance[i].extinction + grey * e) / all;
          appearance[i].extinction = all;
        }
      }
  }

  void find_normals() {
    // includes one voxel more on either side
    const Box<float> opacity = smoothed(labels_, opacities_, encoding_.kernels_);
    const Eigen::Matrix3d to_patient = encoding_.to_patient_ / 2;
    const double smallest = kFaintGradient * surface_gradient_per_mm(encoding_.grid_);
    for (int k = renormalised_[2][0]; k < renormalised_[2][1]; ++k)
      for (int j = renormalised_[1][0]; j < renormalised_[1][1]; ++j) {
        const auto smoothed_row = [&](int jj, int kk) {
          return opacity.row(jj - renormalised_[1][0] + 1, kk - renormalised_[2][0] + 1);
        };
        const float *here = smoothed_row(j, k), *back = smoothed_row(j - 1, k),
                    *front = smoothed_row(j + 1, k), *below = smoothed_row(j, k - 1),
                    *above = smoothed_row(j, k + 1);
        const std::size_t row = offset(0, j, k);
        for (int i = renormalised_[0][0]; i < renormalised_[0][1]; ++i) {
          const std::size_t n = row + static_cast<std::size_t>(i);
          const int at = i - renormalised_[0][0] + 1;
          const double facing = sidedness(here[at]);
          if (facing == 0 || appearances_[n].extinction == 0) continue;
          const Eigen::Vector3d gradient =
              to_patient *
              Eigen::Vector3d(here[at + 1] - here[at - 1], front[at] - back[at], above[at] - below[at]);
          const std::size_t turned = normal_offset(1, i, j, k);
          const Eigen::Vector3d normal =
              gradient * (facing * kNormalSteps / std::max(gradient.norm(), smallest));
          for (std::size_t a = 0; a < 3; ++a) {
            const std::int8_t component = rounded(normal[static_cast<Eigen::Index>(a)]);
            normals_[0][a][n] = component;
            normals_[1][a][turned] = component;
          }
        }
      }
  }

  void fill_appearance(VoxelBlock& block, int index, std::size_t voxel) const {
    const VoxelAppearance& appearance = appearances_[voxel];
    // rounds non-negative values
    const auto whole = [](float value) { return static_cast<int>(value + 0.5f); };
    block.extinction[index] =
        static_cast<std::uint16_t>(whole(std::min(appearance.extinction * kDepthSteps, 60000.0f)));
    // an invisible voxel has a canonical colour
    for (std::size_t a = 0; a < 3; ++a)
      block.colour[a][index] = appearance.extinction == 0
                                   ? std::uint8_t{0}
                                   : static_cast<std::uint8_t>(whole(appearance.colour[a]));
  }
  /// Normals of a block as eight-byte words per component, restricted to those that may differ.
  struct NormalWords {
    std::uint64_t differing;  ///< Byte mask
    std::array<std::uint64_t, 3> made;

    static std::uint64_t word(const std::int8_t* bytes) {
      std::uint64_t word;
      static_assert(sizeof word == kBlock);
      std::memcpy(&word, bytes, sizeof word);
      return word;
    }
    bool are_of(const VoxelBlock& block) const {
      std::uint64_t others = 0;
      for (std::size_t a = 0; a < 3; ++a) others |= word(block.normal[a]) ^ made[a];
      return (others & differing) == 0;
    }
    void write_into(VoxelBlock& block) const {
      for (std::size_t a = 0; a < 3; ++a) {
        const std::uint64_t mixed = (word(block.normal[a]) & ~differing) | (made[a] & differing);
        std::memcpy(block.normal[a], &mixed, sizeof mixed);
      }
    }
  };
  /// @param along       axis of the block
  /// @param at          its first voxel
  /// @param first, end  voxels whose normals may differ
  NormalWords normal_words(std::size_t along, const std::array<int, 3>& at, int first, int end) const {
    std::array<std::uint8_t, kBlock> differing{};
    for (int n = first; n < end; ++n) differing[static_cast<std::size_t>(n)] = 0xff;
    NormalWords words{};
    std::memcpy(&words.differing, differing.data(), sizeof words.differing);
    const std::size_t index =
        normal_offset(along, at[0] - box_.first[0], at[1] - box_.first[1], at[2] - box_.first[2]);
    for (std::size_t a = 0; a < 3; ++a) words.made[a] = NormalWords::word(normals_[along][a].data() + index);
    return words;
  }
  /// @param along  0: i fastest, 1: j fastest
  std::size_t normal_offset(std::size_t along, int i, int j, int k) const {
    const int fast = along == 0 ? i : j, slow = along == 0 ? j : i;
    return static_cast<std::size_t>(fast) +
           static_cast<std::size_t>(box_.size[along]) *
               (static_cast<std::size_t>(slow) +
                static_cast<std::size_t>(box_.size[1 - along]) * static_cast<std::size_t>(k));
  }

  const VolumeEncoding& encoding_;
  VoxelBox box_;
  Region changed_, renormalised_;
  std::array<int, 3> margin_;
  Box<LabelId> labels_;
  std::vector<StructureOptics> optics_;  ///< By label
  std::vector<float> opacities_;         ///< By label, and one entry for all labels beyond
  std::vector<VoxelAppearance> appearances_;
  /// Normals in the order of either kind of rows, by component; 0 where nothing is visible.
  std::array<std::array<std::vector<std::int8_t>, 3>, 2> normals_;
};

// ---- the whole --------------------------------------------------------------------------------------------

VolumeEncoding::VolumeEncoding(const GridGeometry& grid, std::span<const StructureAppearance> appearances,
                               ScanAppearance scan)
    : grid_(grid),
      appearances_(appearances.begin(), appearances.end()),
      scan_(std::move(scan)),
      to_patient_(grid.X_PatientVoxel().linear().inverse().transpose()),
      rows_{BlockRows(grid, 0), BlockRows(grid, 1)},
      skips_(grid) {
  const auto sigma = sigma_in_voxels(grid, normal_sigma_mm(grid));
  for (std::size_t a = 0; a < 3; ++a) kernels_[a] = smoothing_kernel(sigma ? (*sigma)[a] : 0);
}

Result<void> VolumeEncoding::encode(const Bricks<LabelId>& labels, const VoxelBox& box, int threads,
                                    const Progress& progress) {
  // whole blocks along i and along j
  const std::array<int, 3> margin = Tile::margins(*this);
  std::array<int, 3> from{}, to{}, tiles{};
  for (std::size_t a = 0; a < 3; ++a) {
    from[a] = std::max(0, box.first[a] - margin[a]);
    if (a < 2) from[a] = from[a] / kBlock * kBlock;
    to[a] = std::min(grid_.dims[a], box.first[a] + box.size[a] + margin[a]);
    if (a < 2) to[a] = std::min(grid_.dims[a], blocks_along(to[a]) * kBlock);
    tiles[a] = std::max(0, to[a] - from[a] + kTileSide - 1) / kTileSide;
  }
  // a voxel's appearance depends on the 27 around it; emptiness is not stored for voxels that show the scan
  // only, so everything is rebuilt with a scan
  VoxelBox changed, renormalised;
  const bool is_all = is_new_ || scan_.scan != nullptr;
  for (std::size_t a = 0; a < 3; ++a) {
    const auto widen = [&](VoxelBox& wide, int by) {
      wide.first[a] = is_all ? from[a] : std::max(0, box.first[a] - by);
      const int end = is_all ? to[a] : std::min(grid_.dims[a], box.first[a] + box.size[a] + by);
      wide.size[a] = end - wide.first[a];
    };
    widen(changed, 1);
    widen(renormalised, margin[a]);
  }
  // a region too small for one tile per worker is cut into thinner tiles
  int thickness = kTileSide;
  const int workers = worker_count(threads, std::numeric_limits<int>::max()), columns = tiles[0] * tiles[1];
  if (columns > 0 && columns * tiles[2] < workers) {
    const int slices = to[2] - from[2], layers = (workers + columns - 1) / columns;
    thickness = std::clamp((slices + layers - 1) / layers, kBlock, kTileSide);
    tiles[2] = (slices + thickness - 1) / thickness;
  }
  const int count = columns * tiles[2];
  struct PositionedBlock {
    int rows, i, j, k;
    VoxelBlock block;
  };
  std::mutex putting;
  // data that other workers read are modified later
  std::vector<std::vector<PositionedBlock>> later(is_new_ ? 0 : static_cast<std::size_t>(count));
  const auto put_all = [&](const std::vector<PositionedBlock>& made) {
    for (const PositionedBlock& m : made) rows_[static_cast<std::size_t>(m.rows)].put(m.i, m.j, m.k, m.block);
  };
  std::atomic<int> done{0};
  const bool whole = for_each_index(count, std::min(workers, count), [&](int worker, int n) {
    if (progress.stopped()) return false;
    const std::array<int, 3> tile{n % tiles[0], n / tiles[0] % tiles[1], n / tiles[0] / tiles[1]};
    VoxelBox part;
    for (std::size_t a = 0; a < 3; ++a) {
      const int side = a == 2 ? thickness : kTileSide;
      part.first[a] = from[a] + tile[a] * side;
      part.size[a] = std::min(side, to[a] - part.first[a]);
    }
    std::vector<PositionedBlock> made;
    made.reserve(kUsualBlocks);
    Tile(*this, labels, part, changed, renormalised)
        .for_each_block([&](int rows, int i, int j, int k, const VoxelBlock& block) {
          // initially all blocks are empty
          const bool is_empty = std::all_of(std::begin(block.extinction), std::end(block.extinction),
                                            [](auto e) { return e == 0; });
          if (!is_new_ || !is_empty) made.push_back({rows, i, j, k, block});
        });
    if (is_new_) {
      const std::lock_guard lock(putting);
      put_all(made);
    } else {
      later[static_cast<std::size_t>(n)] = std::move(made);
    }
    if (worker == 0)
      progress.report("volume", static_cast<double>(++done) / count);
    else
      ++done;
    return true;
  });
  if (!whole) return Progress::interrupted();
  const auto append_later = [&](int rows) {
    for (const std::vector<PositionedBlock>& made : later)
      for (const PositionedBlock& m : made)
        if (m.rows == rows) rows_[static_cast<std::size_t>(rows)].put(m.i, m.j, m.k, m.block);
  };
  for_each_index(2, std::min(workers, 2), [&](int, int rows) {
    append_later(rows);
    // skips use the rows along i
    if (rows == 0) skips_.update(rows_[0], changed);
    return true;
  });
  is_new_ = false;
  return {};
}

}  // namespace palpate::internal::volume_picture
