#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/cache/digest.h"
#include "palpate/model/model_preparation.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/preparation/preparation.h"
#include "palpate/volume/label_map.h"

/// Cached versions of the slow preparation steps (docs/guide/cache.md). Each is the function of
/// palpate/preparation/preparation.h, ramps.h, surfaces.h, phantoms.h or volume.h with the same parameters,
/// results and errors, bit for bit. Cache keys are digests of everything the function reads; names are not
/// part of them.
namespace palpate {

/// Version of the cached results. Increment it whenever a function's result for the same parameters changes,
/// which invalidates earlier entries. The test CachedPreparation.GoldenHash detects an omission.
inline constexpr std::uint32_t kPreparationVersion = 9;

/// Cached slow steps of one model; labels are identified by their address.
class CachedPreparation final : public ModelPreparation {
 public:
  Result<Ramps> ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                      const RampOptions& options, const Progress& progress) const override;
  Result<std::vector<std::pair<LabelId, LabelId>>> touching_pairs(const Bricks<LabelId>& labels,
                                                                  const std::vector<LabelId>& structures,
                                                                  const Progress& progress) const override;
  Result<std::vector<std::shared_ptr<const Surface>>> outer_surfaces(
      const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
      const SurfaceOptions& options, const Progress& progress) const override;

 private:
  // digest of the labels' voxels and grid, the cache key of results derived from them; empty if the cache is
  // disabled
  const std::optional<cache::Digest>& digest_of(const Bricks<LabelId>& labels) const;

  mutable const Bricks<LabelId>* labels_ = nullptr;
  mutable std::optional<cache::Digest> labels_digest_;
};

Result<Volume<std::uint8_t>> cached_smooth(const Volume<std::uint8_t>& weights,
                                           const GaussianOptions& options, const Progress& progress);
Result<Volume<std::uint16_t>> cached_smooth_16(const Volume<std::uint8_t>& weights,
                                               const GaussianOptions& options, const Progress& progress);

/// Cached resample_linear and resample_nearest.
Result<Volume<float>> cached_resampled(const Volume<float>& scan, const GridGeometry& grid, float outside,
                                       const Progress& progress);
Result<LabelMap> cached_resampled(const LabelMap& labels, const GridGeometry& grid, const Progress& progress);

Result<Phantom> cached_phantom(const PhantomParameters& parameters, const Progress& progress);

}  // namespace palpate
