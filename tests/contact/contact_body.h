#pragma once

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "palpate/contact/proxy.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume_io/volume_io.h"

/// Label maps as bodies that a proxy presses on, for tests of contact.
namespace palpate::test {

/// A prepared, frictionless model and its contact surfaces.
struct Body {
  std::shared_ptr<const Model> model;
  std::vector<ContactSurface> surfaces;

  bool is_touchable(LabelId label) const { return model->is_touchable(label); }
  /// Whether `surface` exists, is on `layer` and is not covered by another surface, so that a tool that has
  /// punctured nothing can touch it.
  bool is_active_surface(const ContactSurface& surface, int layer = 0) const {
    return surface.surface != nullptr && surface.covered_by < 0 && surface.layer == layer;
  }
  double clearance_mm(const Point<Patient>& at, double radius_mm, int layer = 0) const {
    double smallest = std::numeric_limits<double>::infinity();
    for (const ContactSurface& surface : surfaces)
      if (is_active_surface(surface, layer))
        smallest = std::min(smallest, surface.surface->distance_mm(at) - radius_mm);
    return smallest;
  }
  /// Nearest point from `target` along `outward` from which a sphere has more than 0.2 mm of clearance up to
  /// far_mm; empty: there is none.
  std::optional<Point<Patient>> free_place(const Point<Patient>& target, const Vector<Patient>& outward,
                                           double radius_mm, double far_mm) const {
    std::optional<Point<Patient>> first;
    for (double path_mm = 0; path_mm <= far_mm; path_mm += 0.1) {
      const Point<Patient> at = target + outward * path_mm;
      const bool free = clearance_mm(at, radius_mm) > 0.2;
      if (free && !first) first = at;
      if (!free) first.reset();
    }
    return first;
  }
  Vector<Patient> outward(const Point<Patient>& at) const {
    const ContactSurface* nearest = nullptr;
    for (const ContactSurface& surface : surfaces)
      if (is_active_surface(surface) &&
          (nearest == nullptr || surface.surface->distance_mm(at) < nearest->surface->distance_mm(at)))
        nearest = &surface;
    return nearest->surface->outward(at);
  }
};

/// Whether every centre of a touchable voxel is farther from `at` than `clear_mm` plus half a voxel diagonal.
inline bool is_clear_of_voxels(const Body& body, const Point<Patient>& at, double clear_mm) {
  const Bricks<LabelId>& labels = *body.model->labels;
  const GridGeometry& grid = labels.geometry();
  const double far_mm = clear_mm + 0.5 * grid.spacing_mm.norm();
  const Eigen::Vector3d p = (grid.X_PatientVoxel().inverse() * at).eigen();
  const Eigen::Vector3d reach = far_mm * grid.spacing_mm.cwiseInverse();
  const auto low = [&](int a) { return static_cast<int>(std::ceil(p[a] - reach[a])); };
  for (int k = low(2); k <= p.z() + reach.z(); ++k)
    for (int j = low(1); j <= p.y() + reach.y(); ++j)
      for (int i = low(0); i <= p.x() + reach.x(); ++i)
        if (body.is_touchable(labels.anywhere(i, j, k)) &&
            (Eigen::Vector3d(i, j, k) - p).cwiseProduct(grid.spacing_mm).norm() < far_mm)
          return false;
  return true;
}

inline Model model_of(const LabelMap& map,
                      const std::function<std::optional<double>(const Segment&)>& stiffness_of) {
  Model model;
  model.labels = label_bricks(map.flattened());
  const std::vector<std::size_t> voxels = label_counts(*model.labels);
  for (std::size_t label = 0; label < voxels.size(); ++label)
    if (voxels[label] > 0) model.tissue_of_label.resize(label + 1, -1);
  for (const Segment& segment : map.segments) {
    const std::optional<double> stiffness = stiffness_of(segment);
    if (!stiffness || segment.id >= model.tissue_of_label.size()) continue;
    model.tissue_of_label[segment.id] = static_cast<std::int16_t>(model.tissues.size());
    Tissue tissue;
    tissue.name = segment.name;
    tissue.stiffness_N_per_mm = *stiffness;
    tissue.friction = tissue.static_friction = 0;
    model.tissues.push_back(tissue);
  }
  return model;
}

// preset stiffness of a structure, found by its name as in a proposed scene; empty: not touchable
inline std::optional<double> as_proposed(const Segment& segment) {
  const TissuePreset* preset = match_preset(segment.name).preset;
  if (preset == nullptr || !preset->values.touchable) return {};
  return preset->values.stiffness_N_per_mm;
}

inline Body one_body(const Model& model) {
  const std::array methods{ForceMethod::kProxy};
  const auto ready = prepared_with_cache(std::make_shared<const Model>(model), methods);
  EXPECT_TRUE(ready.ok());
  return {*ready, (*ready)->surfaces};
}

/// Touchable voxels with an untouchable face neighbour: all of them, and those with another touchable label
/// among their 26 neighbours.
struct ExposedVoxels {
  std::vector<std::array<int, 3>> all, seams;

  /// @param at_seam  where there are seams
  Point<Voxel> any(bool at_seam, std::mt19937& random) const {
    const auto& among = at_seam && !seams.empty() ? seams : all;
    const auto& voxel = among[std::uniform_int_distribution<std::size_t>(0, among.size() - 1)(random)];
    return Point<Voxel>(voxel[0], voxel[1], voxel[2]);
  }
};

inline ExposedVoxels exposed_voxels(const Body& body) {
  ExposedVoxels found;
  const Bricks<LabelId>& labels = *body.model->labels;
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const LabelId own = labels.at(i, j, k);
        if (!body.is_touchable(own)) continue;
        bool exposed = false, seam = false;
        for (int n = 0; n < 27; ++n) {
          const int di = n % 3 - 1, dj = n / 3 % 3 - 1, dk = n / 9 - 1;
          const LabelId other = labels.anywhere(i + di, j + dj, k + dk);
          const bool touchable = body.is_touchable(other);
          exposed = exposed || (!touchable && std::abs(di) + std::abs(dj) + std::abs(dk) == 1);
          seam = seam || (touchable && other != own);
        }
        if (exposed) found.all.push_back({i, j, k});
        if (exposed && seam) found.seams.push_back({i, j, k});
      }
  return found;
}

inline std::optional<LabelMap> labels_of(const std::filesystem::path& file) {
  const auto read = read_labels(file);
  EXPECT_TRUE(read.ok());
  if (!read.ok()) return {};
  return read->labels;
}

}  // namespace palpate::test
