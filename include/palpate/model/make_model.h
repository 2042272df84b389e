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
#include "palpate/haptics/haptics.h"
#include "palpate/model/preparing.h"

/// Labels become a Model that can be felt.
namespace palpate {

/// What a model is made of.
struct ModelParts {
  std::string title;
  std::shared_ptr<const Bricks<LabelId>> labels;  ///< label_bricks
  std::vector<Segment> segments;                  ///< names and colours by id, ascending
  std::vector<Tissue> tissues;
  std::vector<std::int16_t> tissue_of_label;  ///< index by LabelId; -1 and beyond the table: of no tissue
  std::vector<Tool> tools{Tool()};            ///< Model::tools
  MethodSettings method_settings;
  TissueLaw tissue_law = TissueLaw::kLayers;  ///< Model::tissue_law
  double tissue_cell_mm = 0;                  ///< Model::tissue_cell_mm
  double sigma_mm = 1;                        ///< of the smooth sphere, and of a smoothed field
  double max_force_N =
      std::numeric_limits<double>::infinity();  ///< infinite: none but the device's and user's
  std::vector<NoGoRegion> no_go;                ///< Model::no_go
  ToldDistances told_distances;                 ///< Model::told_distances

  // what the direct methods read: inward ramps, or a field that was made elsewhere
  std::optional<double> ramp_width_mm;  ///< empty: what ramp_width_mm() takes
  bool eight_bits = false;              ///< of a ramp's value; else 16
  std::shared_ptr<const Field> smoothed;
  double smoothed_reach_mm = 0;  ///< how far from a structure that field may be felt
};

/// A model, and how its ramps came out.
struct MadeModel {
  /// Ready for the trilinear method. What is only shown (scan, side) can still be added.
  std::shared_ptr<Model> model;
  std::vector<RampFigures> ramps;  ///< one for each felt structure; of a smoothed field none
  double full_force_N = 0;         ///< of these ramps
};
/// Where nothing is felt its field is 0 everywhere.
/// Errors: kBadInput for a ramp that does not suit the voxels, a burr less than two voxels across, an elastic
/// constant out of its range (elastic_constants.h), a relaxation that none can have or more times of them
/// than there is room for, cells of no size, a no-go region that none can be (check_no_go), and those of
/// prepare_ramps; kInterrupted.
Result<MadeModel> make_model(ModelParts parts, const Preparing& preparing = {},
                             const Progress& progress = {});

/// The same model, ready for these methods as well; itself where it already is. For the proxy felt structures
/// that touch get one outer surface, and all others their own (palpate/surfaces/surfaces.h), which takes
/// seconds; of those that touch, the ones with a puncture force and what lies beneath them have surfaces
/// besides. Structures whose distances the model asks for, or that are no-go regions, get a surface of their
/// own and its tree, whatever the methods. What is added changes neither version nor content hash. Errors:
/// those of with_methods and prepare_surfaces; more surfaces than the proxy takes; kInterrupted.
Result<std::shared_ptr<const Model>> prepared_for(std::shared_ptr<const Model> model,
                                                  std::span<const ForceMethod> methods,
                                                  const Preparing& preparing = {},
                                                  const Progress& progress = {});

/// The surfaces and trees alone that distances and no-go regions need; itself where it has them. Until then
/// regions of structures push nobody. Nothing was cut. Errors: those of prepare_surfaces; kInterrupted.
Result<std::shared_ptr<const Model>> with_distances(std::shared_ptr<const Model> model,
                                                    const Preparing& preparing = {},
                                                    const Progress& progress = {});

/// Every structure that distances and no-go regions need, ascending, each once.
std::vector<LabelId> tracked_structures(const std::vector<NoGoRegion>& no_go, const ToldDistances& told);

}  // namespace palpate
