#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/contact/model.h"
#include "palpate/model/model_preparation.h"

/// Builds a Model from labels.
namespace palpate {

/// Input of make_model().
struct ModelParts {
  std::string title;
  std::shared_ptr<const Bricks<LabelId>> labels;  ///< From label_bricks()
  std::vector<Segment> segments;                  ///< Names and colours by id, ascending
  std::vector<Tissue> tissues;
  std::vector<std::int16_t> tissue_of_label;  ///< By LabelId; -1 or beyond the end: no tissue
  std::vector<Tool> tools{Tool()};            ///< Model::tools
  MethodSettings method_settings;
  TissueLaw tissue_law = TissueLaw::kLayers;  ///< Model::tissue_law
  double tissue_cell_mm = 0;                  ///< Model::tissue_cell_mm
  double sigma_mm = 1;  ///< Gaussian width of the smooth sphere, and of a smoothed field
  /// Scene's force limit; infinite: none besides the device's and user's
  double max_force_N = std::numeric_limits<double>::infinity();
  std::shared_ptr<const Volume<float>> scan;  ///< Model::scan, on the grid of `labels`; may be null
  double full_density_HU = 0;                 ///< Model::full_density_HU; above 0: needs `scan`
  std::vector<NoGoRegion> no_go;              ///< Model::no_go
  ReportedDistances reported_distances;       ///< Model::reported_distances

  // field of the direct methods: inward ramps, or one computed elsewhere
  std::optional<double> ramp_width_mm;  ///< Empty: chosen by ramp_width_mm()
  bool eight_bits = false;              ///< Resolution of a ramp's values; else 16 bits
  std::shared_ptr<const Field> smoothed;
  double smoothed_reach_mm = 0;  ///< Distance from a structure within which `smoothed` may exert force
};

/// Builds a model from its parts. It still has to be prepared for a force method, by prepared_for(): its
/// inward ramps are made where a direct method is first prepared. Only a smoothed field, and that of a model
/// without touchable structures, which is 0 everywhere, are there from the start, with the trilinear method.
/// Data for display only (scan, side) can be added. Errors: kBadInput for parts that are missing or not
/// finite and for indices or ids out of range, with the name of the member as location; for a ramp width that
/// does not suit the voxels, a burr less than two voxels across, an elastic constant out of range
/// (elastic_constants.h), an invalid relaxation or too many different relaxation times, an invalid cell size,
/// or an invalid no-go region (check_no_go).
Result<std::shared_ptr<Model>> make_model(ModelParts parts);

/// Result of with_ramp_field().
struct RampFieldResult {
  std::shared_ptr<const Model> model;  ///< Prepared for the trilinear method
  std::vector<RampStatistics> ramps;   ///< One per touchable structure
  double full_force_N = 0;             ///< Full scale of these ramps
};
/// The model with a new field of inward ramps for its tissues, and with no direct method but the trilinear
/// one. Requires Model::ramp_width_mm > 0. Version and content hash do not change. Errors: those of
/// prepare_ramps; kInterrupted.
Result<RampFieldResult> with_ramp_field(const Model& model, const ModelPreparation& preparation = {},
                                        const Progress& progress = {});

/// The model prepared for additional direct methods, with their field if it has none yet; the same object if
/// it already is. Version and content hash do not change. Errors: those of with_ramp_field() and of
/// with_methods() (palpate/direct/direct_methods.h).
Result<std::shared_ptr<const Model>> with_direct_methods(std::shared_ptr<const Model> model,
                                                         std::span<const ForceMethod> methods,
                                                         const ModelPreparation& preparation = {},
                                                         const Progress& progress = {});

/// The model prepared for these methods in addition to its own; the same object if it already is. For a
/// direct method it gets the field that these methods share; a model for the proxy alone has none. For the
/// proxy, touchable structures that touch get a common outer surface, all others their own
/// (palpate/surfaces/surfaces.h), which takes seconds; among structures that touch, those with a puncture
/// force and the remainder beneath them get additional surfaces. Structures whose distances the model
/// reports, or that are no-go regions, get their own surface and its tree, whatever the methods. Version and
/// content hash do not change. Errors: those of with_direct_methods and prepare_surfaces; kBadInput for more
/// surfaces than the proxy supports; kInterrupted.
Result<std::shared_ptr<const Model>> prepared_for(std::shared_ptr<const Model> model,
                                                  std::span<const ForceMethod> methods,
                                                  const ModelPreparation& preparation = {},
                                                  const Progress& progress = {});

/// Adds only the surfaces and trees for distances and no-go regions; the same object if it has them. Without
/// them, no-go regions of structures exert no force. Requires that nothing was cut. Errors: those of
/// prepare_surfaces; kInterrupted.
Result<std::shared_ptr<const Model>> with_distances(std::shared_ptr<const Model> model,
                                                    const ModelPreparation& preparation = {},
                                                    const Progress& progress = {});

/// Structures that distances and no-go regions need, ascending, without duplicates.
std::vector<LabelId> tracked_structures(const std::vector<NoGoRegion>& no_go,
                                        const ReportedDistances& distances);

}  // namespace palpate
