#include "palpate/tissue/fragments.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <unordered_set>
#include <utility>

#include "tissue/swept_voxels.h"

namespace palpate {
namespace {

using FragmentVoxel = std::array<int, 3>;

/// Effect of a label on a component.
enum class Role : std::uint8_t { kFree, kCut, kSpared };

Role role_of(const Model& model, LabelId label) {
  if (!model.is_touchable(label)) return Role::kFree;
  return model.tissue_of(label)->protection == Protection::kNone ? Role::kCut : Role::kSpared;
}

/// 26-connected components of the voxels of touchable tissue.
class Components {
 public:
  Components(const Model& model, const Carving& carving)
      : labels_(*carving.labels()),
        original_(*carving.original_labels()),
        grid_(labels_.geometry()),
        max_voxels_(static_cast<std::size_t>(kMaxFragment_mm3 / grid_.spacing_mm.prod())) {
    roles_.resize(model.tissue_of_label.size());
    for (std::size_t label = 0; label < roles_.size(); ++label)
      roles_[label] = role_of(model, static_cast<LabelId>(label));
  }

  // Voxels of the fragment that contains a voxel; empty if it is part of something else, or was returned
  // before.
  std::vector<FragmentVoxel> fragment_at(const FragmentVoxel& seed) {
    if (role(labels_, seed) != Role::kCut || known_.contains(number_of(seed))) return {};
    std::vector<FragmentVoxel> component = component_at(labels_, seed, known_);
    const bool is_whole = component.size() <= max_voxels_ && !reached_known_;
    if (!is_whole || is_spared_) return {};
    std::unordered_set<std::size_t> before;
    if (component_at(original_, seed, before).size() <= max_voxels_) return {};
    return component;
  }

 private:
  std::size_t number_of(const FragmentVoxel& at) const {
    return (static_cast<std::size_t>(at[2]) * static_cast<std::size_t>(grid_.dims[1]) +
            static_cast<std::size_t>(at[1])) *
               static_cast<std::size_t>(grid_.dims[0]) +
           static_cast<std::size_t>(at[0]);
  }
  Role role(const Bricks<LabelId>& labels, const FragmentVoxel& at) const {
    const LabelId label = labels.at(at[0], at[1], at[2]);
    return label < roles_.size() ? roles_[label] : Role::kFree;
  }

  // Voxels connected to a seed, at most one more than max_voxels_. Adds them to `known`, and stops at a voxel
  // that was known before, since it belongs to a component that is no fragment.
  std::vector<FragmentVoxel> component_at(const Bricks<LabelId>& labels, const FragmentVoxel& seed,
                                          std::unordered_set<std::size_t>& known) {
    reached_known_ = is_spared_ = false;
    std::unordered_set<std::size_t> own{number_of(seed)};
    std::vector<FragmentVoxel> component{seed};
    for (std::size_t next = 0; next < component.size() && component.size() <= max_voxels_ && !reached_known_;
         ++next) {
      const FragmentVoxel at = component[next];
      is_spared_ = is_spared_ || role(labels, at) == Role::kSpared;
      for (int n = 0; n < 27; ++n) {
        const FragmentVoxel beside{at[0] + n % 3 - 1, at[1] + n / 3 % 3 - 1, at[2] + n / 9 - 1};
        if (!grid_.contains(beside[0], beside[1], beside[2]) || role(labels, beside) == Role::kFree) continue;
        if (!own.insert(number_of(beside)).second) continue;
        reached_known_ = reached_known_ || known.contains(number_of(beside));
        component.push_back(beside);
      }
    }
    known.merge(own);
    return component;
  }

  const Bricks<LabelId>&labels_, &original_;
  const GridGeometry grid_;
  const std::size_t max_voxels_;
  std::vector<Role> roles_;
  std::unordered_set<std::size_t> known_;  // voxels of components found before
  bool reached_known_ = false, is_spared_ = false;
};

// calls run(voxel) for the voxels around a sweep whose neighbours it may have removed
template <class Run>
void for_shell(const Sweep& sweep, const GridGeometry& grid, const Run& run) {
  const double beside_mm = 1.01 * grid.spacing_mm.norm();
  const VoxelBox box = voxels_around(sweep, sweep.max_radius_mm() + beside_mm, grid);
  const SweptShape shape(sweep);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = box.first[2]; k < box.first[2] + box.size[2]; ++k)
    for (int j = box.first[1]; j < box.first[1] + box.size[1]; ++j)
      for (int i = box.first[0]; i < box.first[0] + box.size[0]; ++i) {
        const double depth_mm = shape.depth_mm(X_PatientVoxel * Point<Voxel>(i, j, k));
        if (depth_mm > -beside_mm && !(depth_mm > 0)) run(FragmentVoxel{i, j, k});
      }
}

// capsules that cover the voxels of a fragment, along their rows
void add_capsules(std::vector<FragmentVoxel> fragment, const GridGeometry& grid, std::uint32_t stroke,
                  std::vector<Cut>& cuts) {
  // covers a cubic voxel and its surface, and reaches no voxel that is not its neighbour
  const double radius_mm = std::min(0.51 * grid.spacing_mm.norm(), 1.4 * grid.spacing_mm.minCoeff());
  constexpr double kMaxLength_mm = 5;
  const int most = std::max(1, static_cast<int>(kMaxLength_mm / grid.spacing_mm[0]));
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  const auto centre = [&](const FragmentVoxel& at) {
    return X_PatientVoxel * Point<Voxel>(at[0], at[1], at[2]);
  };
  std::ranges::sort(fragment, [](const FragmentVoxel& a, const FragmentVoxel& b) {
    return std::array{a[2], a[1], a[0]} < std::array{b[2], b[1], b[0]};
  });
  for (std::size_t begin = 0; begin < fragment.size();) {
    std::size_t end = begin + 1;
    const FragmentVoxel& first = fragment[begin];
    while (end < fragment.size() && static_cast<int>(end - begin) < most &&
           fragment[end] == FragmentVoxel{first[0] + static_cast<int>(end - begin), first[1], first[2]})
      ++end;
    cuts.push_back({Cut::kBrokenOff, {centre(first), centre(fragment[end - 1]), radius_mm, stroke}});
    begin = end;
  }
}

}  // namespace

std::vector<Cut> fragments_of(const Model& model, const Carving& carving, std::span<const Cut> cuts) {
  std::vector<Cut> fragments;
  if (carving.original_labels() == nullptr || cuts.empty()) return fragments;
  const GridGeometry& grid = carving.original_labels()->geometry();
  Components components(model, carving);
  for (const Cut& cut : cuts)
    for_shell(cut.sweep, grid, [&](const FragmentVoxel& at) {
      if (auto fragment = components.fragment_at(at); !fragment.empty())
        add_capsules(std::move(fragment), grid, cuts.back().sweep.stroke, fragments);
    });
  return fragments;
}

}  // namespace palpate
