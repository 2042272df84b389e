#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "palpate/cache/digest.h"
#include "palpate/model/preparing.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/preparation/preparation.h"

/// What takes seconds to prepare, taken from the cache where it was prepared before (docs/guide/cache.md).
/// Each is the function of palpate/preparation/preparation.h, ramps.h, surfaces.h, phantoms.h or volume.h
/// with the same parameters, bit for bit, and has its errors. Results are found by everything that the
/// function reads, names never: it reads none.
namespace palpate {

/// Raised by whoever changes what any of these functions gives for the same parameters: what was prepared
/// before is then no longer found. A test says when it was forgotten (KeptPreparation.GoldenHash).
inline constexpr std::uint32_t kPreparationVersion = 7;

/// The slow parts of a model. For one model: labels are told apart by where they stand.
class KeptPreparing final : public Preparing {
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
  // by which kept results of labels are found: of their voxels and grid; nothing where nothing is kept
  const std::optional<cache::Digest>& digest_of(const Bricks<LabelId>& labels) const;

  mutable const Bricks<LabelId>* labels_ = nullptr;
  mutable std::optional<cache::Digest> of_labels_;
};

Result<Volume<std::uint8_t>> kept_smooth(const Volume<std::uint8_t>& weights, const GaussianOptions& options,
                                         const Progress& progress);
Result<Volume<std::uint16_t>> kept_smooth_16(const Volume<std::uint8_t>& weights,
                                             const GaussianOptions& options, const Progress& progress);

/// resample_linear and resample_nearest.
Result<Volume<float>> kept_resampled(const Volume<float>& scan, const GridGeometry& grid, float outside,
                                     const Progress& progress);
Result<LabelMap> kept_resampled(const LabelMap& labels, const GridGeometry& grid, const Progress& progress);

Result<Phantom> kept_phantom(const PhantomParameters& parameters, const Progress& progress);

}  // namespace palpate
