#include "loading/cached_preparation.h"

#include "palpate/surfaces/surfaces.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/resample.h"
#include "palpate/volume/volume.h"

// A browser's worker keeps nothing between sessions: each function computes its result. The fields of the
// direct methods, which need a Fourier transform, are left out.
namespace palpate {
namespace {

Error no_direct_methods() {
  return {ErrorKind::kUnavailable, "the direct force methods are not part of palpate in a browser", "method",
          "choose the proxy"};
}

}  // namespace

Result<Ramps> CachedPreparation::ramps(const Bricks<LabelId>& labels,
                                       const std::vector<RampStructure>& structures,
                                       const RampOptions& options, const Progress& progress) const {
  return ModelPreparation::ramps(labels, structures, options, progress);
}

Result<std::vector<std::pair<LabelId, LabelId>>> CachedPreparation::touching_pairs(
    const Bricks<LabelId>& labels, const std::vector<LabelId>& structures, const Progress& progress) const {
  return ModelPreparation::touching_pairs(labels, structures, progress);
}

Result<std::vector<std::shared_ptr<const Surface>>> CachedPreparation::outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress) const {
  return ModelPreparation::outer_surfaces(labels, groups, options, progress);
}

Result<Volume<std::uint8_t>> cached_smooth(const Volume<std::uint8_t>& /*weights*/,
                                           const GaussianOptions& /*options*/, const Progress& /*progress*/) {
  return no_direct_methods();
}

Result<Volume<std::uint16_t>> cached_smooth_16(const Volume<std::uint8_t>& /*weights*/,
                                               const GaussianOptions& /*options*/,
                                               const Progress& /*progress*/) {
  return no_direct_methods();
}

Result<Volume<float>> cached_resampled(const Volume<float>& scan, const GridGeometry& grid, float outside,
                                       const Progress& /*progress*/) {
  return resample_linear(scan, grid, outside);
}

Result<LabelMap> cached_resampled(const LabelMap& labels, const GridGeometry& grid,
                                  const Progress& /*progress*/) {
  return resample_nearest(labels, grid);
}

Result<Phantom> cached_phantom(const PhantomParameters& parameters, const Progress& progress) {
  return make_phantom(parameters, progress);
}

}  // namespace palpate
