#include "rendering/volume_encoding_tile.h"

#include <cmath>

#include "rendering/volume_terms.h"

namespace palpate::internal::volume_picture {

namespace {

std::int8_t rounded(double value) {
  return static_cast<std::int8_t>(value < 0 ? value - 0.5 : value + 0.5);
}

}  // namespace

VolumeEncoding::Tile::Tile(const VolumeEncoding& encoding, const Bricks<LabelId>& labels, const VoxelBox& box,
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

void VolumeEncoding::Tile::encode_voxels() {
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
}

auto VolumeEncoding::Tile::within(const VoxelBox& box, const VoxelBox& part) -> Region {
  Region region;
  for (std::size_t a = 0; a < 3; ++a) {
    region[a][0] = std::clamp(part.first[a] - box.first[a], 0, box.size[a]);
    region[a][1] = std::clamp(part.first[a] + part.size[a] - box.first[a], region[a][0], box.size[a]);
  }
  return region;
}

StructureOptics VolumeEncoding::Tile::optics_of(const StructureAppearance& appearance) const {
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

void VolumeEncoding::Tile::copy_labels(const Bricks<LabelId>& labels) {
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

void VolumeEncoding::Tile::fill_appearances(const VoxelAppearance& appearance) {
  for (int k = changed_[2][0]; k < changed_[2][1]; ++k)
    for (int j = changed_[1][0]; j < changed_[1][1]; ++j)
      for (int i = changed_[0][0]; i < changed_[0][1]; ++i) appearances_[offset(i, j, k)] = appearance;
}

void VolumeEncoding::Tile::load_unchanged_extinction() {
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

void VolumeEncoding::Tile::find_appearances() {
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

void VolumeEncoding::Tile::add_scan() {
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

void VolumeEncoding::Tile::find_normals() {
  // includes one voxel more on either side
  const Box<float> opacity = smoothed(labels_, opacities_, encoding_.kernels_);
  const Eigen::Matrix3d to_patient = encoding_.to_patient_ / 2;
  const double smallest = kFaintGradient * surface_gradient_per_mm(encoding_.grid_);
  for (int k = renormalised_[2][0]; k < renormalised_[2][1]; ++k)
    for (int j = renormalised_[1][0]; j < renormalised_[1][1]; ++j) {
      const auto smoothed_row = [&](int jj, int kk) {
        return opacity.row(jj - renormalised_[1][0] + 1, kk - renormalised_[2][0] + 1);
      };
      const float *here = smoothed_row(j, k), *back = smoothed_row(j - 1, k), *front = smoothed_row(j + 1, k),
                  *below = smoothed_row(j, k - 1), *above = smoothed_row(j, k + 1);
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

VoxelAppearance VolumeEncoding::Tile::mixture(const LabelId* const* rows, int i) const {
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

void VolumeEncoding::Tile::fill_appearance(VoxelBlock& block, int index, std::size_t voxel) const {
  const VoxelAppearance& appearance = appearances_[voxel];
  // rounds non-negative values
  const auto whole = [](float value) { return static_cast<int>(value + 0.5f); };
  block.extinction[index] =
      static_cast<std::uint16_t>(whole(std::min(appearance.extinction * kDepthSteps, 60000.0f)));
  // an invisible voxel has a canonical colour
  for (std::size_t a = 0; a < 3; ++a)
    block.colour[a][index] =
        appearance.extinction == 0 ? std::uint8_t{0} : static_cast<std::uint8_t>(whole(appearance.colour[a]));
}

auto VolumeEncoding::Tile::normal_words(std::size_t along, const std::array<int, 3>& at, int first,
                                        int end) const -> NormalWords {
  std::array<std::uint8_t, kBlock> differing{};
  for (int n = first; n < end; ++n) differing[static_cast<std::size_t>(n)] = 0xff;
  NormalWords words{};
  std::memcpy(&words.differing, differing.data(), sizeof words.differing);
  const std::size_t index =
      normal_offset(along, at[0] - box_.first[0], at[1] - box_.first[1], at[2] - box_.first[2]);
  for (std::size_t a = 0; a < 3; ++a) words.made[a] = NormalWords::word(normals_[along][a].data() + index);
  return words;
}

}  // namespace palpate::internal::volume_picture
