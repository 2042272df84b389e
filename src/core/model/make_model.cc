#include "palpate/model/make_model.h"

#include <algorithm>
#include <cmath>
#include <concepts>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "model/check_parts.h"
#include "model/relaxation_times.h"
#include "palpate/base/hash.h"
#include "palpate/direct/direct_methods.h"
#include "palpate/model/ramp_structures.h"
#include "palpate/tissue/elastic_grid.h"

namespace palpate {
namespace {

// Hashes of values and of the structs that hold them. Each function binds all members of its struct, so that
// a new member does not compile until it is hashed or left out on purpose.

void hash_value(std::uint64_t& hash, double value) {
  hash_double(hash, value);
}
template <class Value>
requires std::integral<Value> || std::is_enum_v<Value>
void hash_value(std::uint64_t& hash, Value value) {
  hash_word(hash, static_cast<std::uint64_t>(value));
}
void hash_value(std::uint64_t& hash, const Eigen::Vector3d& v) {
  for (int axis = 0; axis < 3; ++axis) hash_double(hash, v[axis]);
}
template <class... Values>
void hash_values(std::uint64_t& hash, const Values&... values);

void hash_value(std::uint64_t& hash, const ElasticConstants& elastic) {
  const auto& [youngs_modulus_kPa, poissons_ratio, stiffening] = elastic;
  hash_values(hash, youngs_modulus_kPa, poissons_ratio, stiffening);
}
void hash_value(std::uint64_t& hash, const Relaxation& relaxation) {
  for (const auto& [part, time_s] : relaxation.term) hash_values(hash, part, time_s);
}
void hash_value(std::uint64_t& hash, const FixedProperties& properties) {
  // opacity is only displayed
  const auto& [touchable, puncture_N, stays_open, friction_damping_N_s_per_mm, friction_max_N,
               cutting_energy_mJ_per_mm3, protection, elastic, relaxation, opacity] = properties;
  hash_values(hash, touchable, puncture_N, stays_open, friction_damping_N_s_per_mm, friction_max_N,
              cutting_energy_mJ_per_mm3, protection, elastic, relaxation);
}
void hash_value(std::uint64_t& hash, const Tissue& tissue) {
  for (const ContactProperty& property : kContactProperties) hash_double(hash, tissue.*property.value);
  hash_value(hash, static_cast<const FixedProperties&>(tissue));
}
void hash_value(std::uint64_t& hash, const ToolCapsule& capsule) {
  const auto& [from_mm, to_mm, radius_mm] = capsule;
  hash_values(hash, from_mm, to_mm, radius_mm);
}
void hash_value(std::uint64_t& hash, const BurrSettings& burr) {
  // whether it is called a shaver affects only the name
  const auto& [revolutions_per_s, grip, spindle, pedal, length_mm, end_radius_mm, shaver, flutes,
               irrigation] = burr;
  hash_values(hash, revolutions_per_s, grip, spindle, pedal, length_mm, end_radius_mm);
  // left out at their defaults, so that recordings of versions without these members have the same model
  if (flutes != BurrSettings{}.flutes || !irrigation) hash_values(hash, flutes, irrigation);
}
void hash_value(std::uint64_t& hash, const Tool& tool) {
  const auto& [name, points_mm, radius_mm, capsules, burr] = tool;
  hash_values(hash, points_mm, radius_mm, capsules, burr);
}
void hash_value(std::uint64_t& hash, const NoGoStructure& structure) {
  // whether the structure is prepared for distances is no property of the scene
  const auto& [label, tracked] = structure;
  hash_value(hash, label);
}
void hash_value(std::uint64_t& hash, const NoGoPlane& plane) {
  const auto& [point, outward] = plane;
  hash_values(hash, point.eigen(), outward.eigen());
}
void hash_value(std::uint64_t& hash, const NoGoSphere& sphere) {
  const auto& [centre, radius_mm] = sphere;
  hash_values(hash, centre.eigen(), radius_mm);
}
void hash_value(std::uint64_t& hash, const NoGoRegion& region) {
  const auto& [name, shape, keep_away_mm, stiffness_N_per_mm] = region;
  hash_word(hash, shape.index());
  std::visit([&](const auto& alternative) { hash_value(hash, alternative); }, shape);
  hash_values(hash, keep_away_mm, stiffness_N_per_mm);
}
void hash_value(std::uint64_t& hash, const MethodSettings& settings) {
  const auto& [sphere_sigma_voxels, normals, coupling_damping_N_s_per_mm] = settings;
  hash_values(hash, sphere_sigma_voxels, normals, coupling_damping_N_s_per_mm);
}
template <class Value>
void hash_value(std::uint64_t& hash, const std::optional<Value>& value) {
  hash_word(hash, std::uint64_t{value.has_value()});
  if (value) hash_value(hash, *value);
}
template <class Value>
void hash_value(std::uint64_t& hash, const std::vector<Value>& values) {
  hash_word(hash, values.size());
  for (const Value& value : values) hash_value(hash, value);
}
template <class... Values>
void hash_values(std::uint64_t& hash, const Values&... values) {
  (hash_value(hash, values), ...);
}

std::uint64_t content_hash(const Model& model) {
  std::uint64_t hash = kHashSeed;
  // ramps follow from labels, tissues and width, so they need not be made for the hash
  if (model.ramp_width_mm > 0)
    hash_value(hash, model.field_in_eight_bits);
  else
    std::visit([&](const auto& voxels) { hash_word(hash, voxels.content_hash()); }, model.field->bricks());
  hash_word(hash, model.labels->content_hash());
  // grids of slightly different size may have the same bricks
  for (const int dim : model.labels->geometry().dims) hash_word(hash, static_cast<std::uint64_t>(dim));
  const auto X = model.labels->geometry().X_PatientVoxel();
  for (int i = 0; i < 9; ++i) hash_double(hash, X.linear()(i / 3, i % 3));
  for (int i = 0; i < 3; ++i) hash_double(hash, X.translation()[i]);
  // no-go regions in order, because telemetry refers to them by index
  hash_values(hash, model.tissues, model.tissue_of_label, model.tools, model.no_go, model.method_settings,
              model.tissue_law, model.tissue_cell_mm, model.sigma_mm, model.ramp_width_mm, model.reach_mm,
              model.scene_max_force_N);
  // without density the scan is only displayed
  if (model.full_density_HU > 0) {
    hash_double(hash, model.full_density_HU);
    const auto& voxels = model.scan->voxels();
    hash_bytes(hash, voxels.data(), voxels.size() * sizeof voxels.front());
  }
  return hash_finish(hash);
}

// a smaller burr would cut a pocket between the voxels, which no voxel represents, and would not sink in
constexpr double kMinBurrVoxels = 2;

Result<void> check_burr_size(const Tool& tool, std::size_t number, const GridGeometry& grid) {
  if (!tool.burr) return {};
  const double voxel_mm = grid.spacing_mm.maxCoeff(), min_mm = kMinBurrVoxels * voxel_mm * (1 - 1e-6);
  const bool tip_fits = 2 * tool.radius_mm >= min_mm;
  const bool end_fits = tool.burr->length_mm <= 0 || 2 * tool.burr->end_radius_mm >= min_mm;
  if (tip_fits && end_fits) return {};
  // report the thinner end of a cone
  const bool is_cone = tool.burr->length_mm > 0 && tool.burr->end_radius_mm != tool.radius_mm;
  const bool is_tip = is_cone && !tip_fits;
  char what[200];
  std::snprintf(what, sizeof what,
                "a %s of %g mm%s is too small for voxels of %.3g mm: it must be at least two voxels wide",
                cutter_name(tool).c_str(), 2 * (tip_fits ? tool.burr->end_radius_mm : tool.radius_mm),
                is_tip ? " at its tip" : "", voxel_mm);
  return Error{ErrorKind::kBadInput, what, "",
               std::string("set a larger `") + (is_tip ? "tip_diameter" : "diameter") + "` under [" +
                   (number == 0 ? "tool" : "second_tool") + "], or give labels with finer voxels"};
}

// elastic constants for which the elastic laws have no solution
Result<void> check_elastic(const ModelParts& parts) {
  for (const Tissue& tissue : parts.tissues) {
    if (!tissue.elastic) continue;
    const ElasticConstants& of = *tissue.elastic;
    if (auto fine =
            check_elastic_material({Matter::kSoft, of.youngs_modulus_kPa, of.poissons_ratio, of.stiffening});
        !fine) {
      Error error = fine.error();
      error.what = "tissue \"" + tissue.name + "\" has " + error.what;
      return error;
    }
  }
  const double cell_mm = parts.tissue_cell_mm;
  if (cell_mm == 0 || (std::isfinite(cell_mm) && cell_mm > 0)) return {};
  return Error{ErrorKind::kBadInput, "the cell size is " + std::to_string(cell_mm) + " mm", "",
               "give their edge in millimetres, or 0 to derive it from the voxel spacing"};
}

// each label's level in the field, 1 for the stiffest tissue
void set_levels(Model& model) {
  // without touchable tissue the value is irrelevant
  const double greatest = model.max_stiffness_N_per_mm();
  const double stiffest = greatest > 0 ? greatest : 1;
  model.level_of_label.assign(model.tissue_of_label.size(), 0.f);
  for (std::size_t label = 0; label < model.level_of_label.size(); ++label)
    if (const Tissue* tissue = model.tissue_of(static_cast<LabelId>(label)))
      model.level_of_label[label] = level_of(*tissue, weight_of(*tissue, stiffest));
}

template <class T>
std::shared_ptr<const Field> field_of(Bricks<T> voxels) {
  return std::make_shared<const Field>(std::move(voxels));
}

// sets the field of the direct methods, and with it the trilinear one
Result<void> set_field(std::shared_ptr<const Field> field, Model& model) {
  model.field = std::move(field);
  auto trilinear = make_force_field(model, ForceMethod::kTrilinear);
  if (!trilinear) return trilinear.error();
  model.methods = {};
  model.methods[index_of(ForceMethod::kTrilinear)] = *std::move(trilinear);
  return {};
}

// field of a model without touchable structures
std::shared_ptr<const Field> empty_field(const GridGeometry& grid, bool eight_bits) {
  return eight_bits ? field_of(Bricks<std::uint8_t>(grid, 0)) : field_of(Bricks<std::uint16_t>(grid, 0));
}

}  // namespace

Result<std::shared_ptr<Model>> make_model(ModelParts parts) {
  if (auto fine = check_parts(parts); !fine) return fine.error();
  const GridGeometry& grid = parts.labels->geometry();
  for (std::size_t number = 0; number < parts.tools.size(); ++number)
    if (auto fine = check_burr_size(parts.tools[number], number, grid); !fine) return fine.error();
  if (auto fine = check_elastic(parts); !fine) return fine.error();
  const auto times = relaxation_times_of(parts.tissues, parts.tissue_law);
  if (!times) return times.error();
  if (auto fine = check_no_go(parts.no_go); !fine) return fine.error();

  auto model = std::make_shared<Model>();
  model->title = std::move(parts.title);
  model->labels = std::move(parts.labels);
  model->segments = std::move(parts.segments);
  model->tissues = std::move(parts.tissues);
  model->tissue_of_label = std::move(parts.tissue_of_label);
  model->tools = std::move(parts.tools);
  model->method_settings = parts.method_settings;
  model->tissue_law = parts.tissue_law;
  model->tissue_cell_mm = parts.tissue_cell_mm;
  model->relaxation_times = *times;
  model->sigma_mm = parts.sigma_mm;
  model->scene_max_force_N = parts.max_force_N;
  model->scan = std::move(parts.scan);
  model->full_density_HU = parts.full_density_HU;
  model->no_go = std::move(parts.no_go);
  model->reported_distances = std::move(parts.reported_distances);
  model->X_WorldPatient = supine_from_feet(grid);
  set_levels(*model);

  if (parts.smoothed != nullptr) {
    model->field_in_eight_bits = parts.smoothed->bytes_per_voxel() == 1;
    model->reach_mm = parts.smoothed_reach_mm;
    if (auto set = set_field(std::move(parts.smoothed), *model); !set) return set.error();
  } else {
    const auto width_mm = ramp_width_mm(parts.ramp_width_mm, grid);
    if (!width_mm) return width_mm.error();
    model->ramp_width_mm = *width_mm;
    model->field_in_eight_bits = parts.eight_bits;
    model->reach_mm = grid.spacing_mm.maxCoeff() + kDeepestRamp_mm;
    if (ramp_structures(*model, *model->labels).empty())
      if (auto set = set_field(empty_field(grid, parts.eight_bits), *model); !set) return set.error();
  }
  model->content_hash = model->hash_before_removal = content_hash(*model);
  return model;
}

Result<RampFieldResult> with_ramp_field(const Model& model, const ModelPreparation& preparation,
                                        const Progress& progress) {
  auto ramps = preparation.ramps(
      *model.labels, ramp_structures(model, *model.labels),
      {.stiffest_N_per_mm = model.max_stiffness_N_per_mm(), .width_mm = model.ramp_width_mm}, progress);
  if (!ramps) return ramps.error();
  auto made = std::make_shared<Model>(model);
  set_levels(*made);
  auto field =
      model.field_in_eight_bits ? field_of(in_eight_bits(ramps->field)) : field_of(std::move(ramps->field));
  if (auto set = set_field(std::move(field), *made); !set) return set.error();
  return RampFieldResult{std::move(made), std::move(ramps->structures), ramps->full_force_N};
}

Result<std::shared_ptr<const Model>> with_direct_methods(std::shared_ptr<const Model> model,
                                                         std::span<const ForceMethod> methods,
                                                         const ModelPreparation& preparation,
                                                         const Progress& progress) {
  if (methods.empty()) return model;
  if (model->field == nullptr) {
    auto made = with_ramp_field(*model, preparation, progress);
    if (!made) return made.error();
    model = std::move(made->model);
  }
  return with_methods(std::move(model), methods, progress);
}

}  // namespace palpate
