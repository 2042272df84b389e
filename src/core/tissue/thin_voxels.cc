#include "palpate/tissue/thin_voxels.h"

#include <algorithm>
#include <atomic>
#include <limits>
#include <vector>

#include "palpate/base/for_each_index.h"
#include "palpate/sampling/sampling.h"
#include "palpate/tissue/cutting_energy.h"
#include "palpate/tissue/tissue_settings.h"

namespace palpate {
namespace {

// Least depth of the ball's centre, as a fraction of its radius: distances of a surface net between voxels
// are smaller than those to the true surface.
constexpr double kMinDepth = 0.7;

/// Surfaces of the innermost layer of contact.
class InnermostSurfaces {
 public:
  explicit InnermostSurfaces(const Model& model) {
    int innermost = 0;
    for (std::size_t n = 0; n < model.label_of_surface.size(); ++n)
      innermost = std::max(innermost, model.surfaces[n].layer);
    for (const ContactSurface& surface : model.surfaces)
      if (surface.layer == innermost && surface.surface != nullptr)
        surfaces_.push_back(surface.surface.get());
  }

  // whether a ball covers a point; a smaller one where the range of the distances does not reach its centre
  bool has_ball_around(const Point<Patient>& at, double radius_mm) const {
    for (const Surface* const surface : surfaces_) {
      const SignedField& position = surface->distance_field();
      const double range_mm = position.steps().outside * position.steps().scale;
      const double within_mm = std::min(radius_mm, 0.9 * range_mm);
      const double distance_mm = surface->distance_mm(at);
      if (distance_mm <= -kMinDepth * within_mm) return true;
      const Vector<Patient> outward = sample_central_differences(position, at).gradient;
      if (!(outward.norm() > 0)) continue;
      const Point<Patient> centre = at - outward.normalized() * (within_mm + distance_mm);
      if (surface->distance_mm(centre) <= -kMinDepth * within_mm) return true;
    }
    return false;
  }

 private:
  std::vector<const Surface*> surfaces_;
};

// calls visit(i, j, k) for a voxel and its neighbours within the grid, while it returns true
template <class Visit>
void for_neighbours(const GridGeometry& grid, int i, int j, int k, const Visit& visit) {
  for (int c = std::max(k - 1, 0); c <= std::min(k + 1, grid.dims[2] - 1); ++c)
    for (int b = std::max(j - 1, 0); b <= std::min(j + 1, grid.dims[1] - 1); ++b)
      for (int a = std::max(i - 1, 0); a <= std::min(i + 1, grid.dims[0] - 1); ++a)
        if (!visit(a, b, c)) return;
}

// marks voxels without energy next to thin ones, unless they are next to thick ones too
void mark_surroundings(const Bricks<LabelId>& labels, const CuttingEnergy& energy,
                       Volume<std::uint8_t>& thin) {
  const GridGeometry& grid = labels.geometry();
  const auto has_energy = [&](int i, int j, int k) { return energy.has_energy()[labels.at(i, j, k)]; };
  const auto mark = [&](int i, int j, int k) {
    if (has_energy(i, j, k) || thin.at(i, j, k) == kNextToThinBone) return true;
    bool beside_thick = false;
    for_neighbours(grid, i, j, k, [&](int a, int b, int c) {
      beside_thick = has_energy(a, b, c) && thin.at(a, b, c) == kNoThinBone;
      return !beside_thick;
    });
    if (!beside_thick) thin.at(i, j, k) = kNextToThinBone;
    return true;
  };
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        if (thin.at(i, j, k) == kThinBone) for_neighbours(grid, i, j, k, mark);
}

}  // namespace

std::shared_ptr<const Bricks<std::uint8_t>> thin_voxels_of(const Model& model) {
  const CuttingEnergy energy(model);
  const InnermostSurfaces surfaces(model);
  const GridGeometry& grid = model.labels->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  Volume<std::uint8_t> thin(grid);
  std::atomic<bool> any = false;
  (void)for_each_index(grid.dims[2], worker_count(0, grid.dims[2]), [&](int /*worker*/, int k) {
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        if (!energy.has_energy()[model.labels->at(i, j, k)]) continue;
        if (surfaces.has_ball_around(X_PatientVoxel * Point<Voxel>(i, j, k), 0.5 * kCuttingSettings.thick_mm))
          continue;
        thin.at(i, j, k) = kThinBone;
        any = true;
      }
    return true;
  });
  if (!any) return nullptr;
  mark_surroundings(*model.labels, energy, thin);
  return std::make_shared<const Bricks<std::uint8_t>>(thin, kNoThinBone);
}

}  // namespace palpate
