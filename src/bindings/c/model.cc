#include "c/model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "c/label_slices.h"
#include "palpate/direct/force_field.h"
#include "palpate/model/make_model.h"

namespace palpate::c {

Result<std::optional<ForceMethod>> method_of(std::int32_t method) {
  if (method == PLP_DEFAULT_METHOD) return std::optional<ForceMethod>();
  if (method < 0 || method >= static_cast<std::int32_t>(kForceMethods.size()))
    return Error{ErrorKind::kBadInput, "there is no force method " + std::to_string(method), "method",
                 "give one of plp_method"};
  return std::optional(static_cast<ForceMethod>(method));
}

namespace {

std::string text_of(const char* text) {
  return text == nullptr ? "" : text;
}

Error null_array(const char* name) {
  return {ErrorKind::kBadInput, "an array that is not empty is null", name, "give its first element"};
}

// Reads an array of structs and converts each. Errors: kBadInput for a null array and invalid sizes.
template <class Struct, class Convert>
Result<void> read_array(const Struct* first, std::size_t count, const char* name, const Convert& convert) {
  if (count == 0) return {};
  const Elements<const Struct> elements(first);
  if (elements.empty()) return null_array(name);
  if (!elements.ok()) return Error{ErrorKind::kBadInput, plp_last_error(), name, ""};
  for (std::size_t n = 0; n < count; ++n) {
    Struct value;
    if (!read(elements[n], value)) return Error{ErrorKind::kBadInput, plp_last_error(), name, ""};
    if (auto fine = convert(value); !fine) return fine;
  }
  return {};
}

Tissue tissue_of(const plp_tissue& from) {
  Tissue tissue;
  tissue.name = text_of(from.name);
  tissue.touchable = from.touchable != 0;
  tissue.stiffness_N_per_mm = from.stiffness_N_per_mm;
  tissue.static_friction = from.static_friction;
  tissue.friction = from.friction;
  tissue.viscosity_N_s_per_mm = from.viscosity_N_s_per_mm;
  tissue.puncture_N = from.puncture_N;
  return tissue;
}

Result<Tool> tool_of(const plp_tool& from) {
  if (from.point_count > kMaxToolParts || from.capsule_count > kMaxToolParts)
    return Error{ErrorKind::kBadInput, "a tool of more than 4 spheres and capsules", "tools", ""};
  if ((from.point_count > 0 && from.points_mm == nullptr) ||
      (from.capsule_count > 0 && from.capsules == nullptr))
    return null_array("tools");
  Tool tool;
  if (from.name != nullptr) tool.name = from.name;
  tool.radius_mm = from.radius_mm;
  if (from.point_count > 0) tool.points_mm.clear();
  for (std::size_t n = 0; n < from.point_count; ++n) tool.points_mm.emplace_back(from.points_mm + 3 * n);
  for (std::size_t n = 0; n < from.capsule_count; ++n) {
    const double* const capsule = from.capsules + 7 * n;
    tool.capsules.push_back({Eigen::Vector3d(capsule), Eigen::Vector3d(capsule + 3), capsule[6]});
  }
  return tool;
}

// Adds the structures to the parts; labels of the volume that no structure names belong to no tissue.
Result<void> add_structures(const plp_structure* structures, std::size_t count, std::vector<bool> present,
                            ModelParts& parts) {
  std::vector<bool> named(present.size(), false);
  const auto read =
      read_array(structures, count, "structures", [&](const plp_structure& from) -> Result<void> {
        if (from.label == 0 || from.label >= present.size() || named[from.label])
          return Error{
              ErrorKind::kBadInput,
              "label " + std::to_string(from.label) +
                  (from.label > 0 && from.label < present.size() ? " is named twice" : " is no structure"),
              "structures", "give each label from 1 to 65535 at most once"};
        if (from.tissue < -1 || from.tissue >= static_cast<std::int64_t>(parts.tissues.size()))
          return Error{ErrorKind::kBadInput,
                       "label " + std::to_string(from.label) + " has tissue " + std::to_string(from.tissue) +
                           " of " + std::to_string(parts.tissues.size()),
                       "structures", "tissues are counted from 0; -1: none"};
        const auto label = static_cast<LabelId>(from.label);
        named[label] = true;
        present[label] = false;
        parts.segments.push_back(
            {label, text_of(from.name), {from.rgb[0], from.rgb[1], from.rgb[2]}, 0, label});
        if (parts.tissue_of_label.size() <= label) parts.tissue_of_label.resize(label + std::size_t{1}, -1);
        parts.tissue_of_label[label] = static_cast<std::int16_t>(from.tissue);
        return {};
      });
  if (!read) return read;
  for (std::size_t label = 1; label < present.size(); ++label)
    if (present[label])
      parts.segments.push_back({static_cast<LabelId>(label), "", {}, 0, static_cast<LabelId>(label)});
  std::sort(parts.segments.begin(), parts.segments.end(),
            [](const Segment& a, const Segment& b) { return a.id < b.id; });
  return {};
}

Result<std::shared_ptr<const Model>> made_model(ModelParts parts, ForceMethod method) {
  auto made = make_model(std::move(parts));
  if (!made) return made.error();
  return prepared_for(*std::move(made), {&method, 1}, {}, cancellable());
}

plp_status create(const plp_labels& labels, const plp_tissue* tissues, std::size_t tissue_count,
                  const plp_structure* structures, std::size_t structure_count, const plp_tool* tools,
                  std::size_t tool_count, const plp_model_options& options, plp_model** model) {
  const auto method = method_of(options.method);
  if (!method) return fail(method.error());
  if (tissue_count > kMaxTissues)
    return fail(PLP_BAD_INPUT, "tissues: a model has at most " + std::to_string(kMaxTissues));
  if (tool_count > kMaxDevices)
    return fail(PLP_BAD_INPUT, "tools: a session has at most " + std::to_string(kMaxDevices) + " devices");

  ModelParts parts;
  parts.title = text_of(options.title);
  parts.max_force_N = options.max_force_N;
  if (auto read = read_array(tissues, tissue_count, "tissues",
                             [&](const plp_tissue& from) -> Result<void> {
                               parts.tissues.push_back(tissue_of(from));
                               return {};
                             });
      !read)
    return fail(read.error());
  if (tool_count > 0) parts.tools.clear();
  if (auto read = read_array(tools, tool_count, "tools",
                             [&](const plp_tool& from) -> Result<void> {
                               auto tool = tool_of(from);
                               if (!tool) return tool.error();
                               parts.tools.push_back(*std::move(tool));
                               return {};
                             });
      !read)
    return fail(read.error());
  if (structure_count > std::numeric_limits<LabelId>::max())
    return fail(PLP_BAD_INPUT, "structures: there are at most 65535 labels");
  auto bricks = label_bricks_of(labels);
  if (!bricks) return fail(bricks.error());
  parts.labels = std::move(bricks->bricks);
  if (auto added = add_structures(structures, structure_count, std::move(bricks->present), parts); !added)
    return fail(added.error());

  auto created = std::make_unique<plp_model>();
  created->method = method->value_or(ForceMethod::kProxy);
  created->loaded.scene.title = parts.title;
  created->loaded.scene.tools = parts.tools;
  created->loaded.scene.force.method = created->method;
  auto made = made_model(std::move(parts), created->method);
  if (!made) return fail(made.error());
  created->loaded.model = created->prepared = *std::move(made);
  *model = created.release();
  return PLP_OK;
}

// a handle of a later version
plp_model* next_of(const plp_model& model, ModelVersions versions) {
  auto next = std::make_unique<plp_model>();
  next->loaded = model.loaded;
  next->loaded.model = std::move(versions.current);
  next->prepared = std::move(versions.prepared);
  next->family = model.family;
  next->method = model.method;
  return next.release();
}

Result<ModelVersions> changed(const plp_model& model, std::size_t tissue, const plp_tissue& properties) {
  const Model& current = model.current();
  if (tissue >= current.tissues.size())
    return Error{ErrorKind::kBadInput,
                 "there is no tissue " + std::to_string(tissue) + ": the model has " +
                     std::to_string(current.tissues.size()),
                 "tissue", "tissues are counted from 0"};
  ModelChange change = current_values(current, tissue);
  change.contact = {properties.stiffness_N_per_mm, properties.static_friction, properties.friction,
                    properties.viscosity_N_s_per_mm};
  auto next = next_version({model.loaded.model, model.prepared}, change, {}, cancellable());
  const bool by_field = model.method != ForceMethod::kProxy;
  if (!next || !by_field || fields_match(*next->current, *next->prepared) ||
      !can_compute_fields(*next->current))
    return next;
  return next_version(*next, {.version = next->current->version + 1, .tissue = ModelChange::kFieldsRebuilt},
                      {}, cancellable());
}

void copy_grid(const GridGeometry& grid, plp_model_info& info) {
  for (int axis = 0; axis < 3; ++axis) {
    info.dims[axis] = grid.dims[static_cast<std::size_t>(axis)];
    info.spacing_mm[axis] = grid.spacing_mm[axis];
    info.origin_mm[axis] = grid.origin[axis];
    for (int column = 0; column < 3; ++column)
      info.direction[3 * axis + column] = grid.direction(axis, column);
  }
}

plp_model_info info_of(const plp_model& model) {
  const Model& current = model.current();
  plp_model_info info{};
  info.version = current.version;
  info.content_hash = current.content_hash;
  info.title = current.title.c_str();
  info.method = static_cast<std::int32_t>(model.method);
  copy_grid(current.labels->geometry(), info);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      info.world_patient[4 * row + column] = current.X_WorldPatient.linear()(row, column);
    info.world_patient[4 * row + 3] = current.X_WorldPatient.translation()[row];
  }
  info.world_patient[15] = 1;
  info.max_force_N = current.scene_max_force_N;
  info.tissues = static_cast<std::uint32_t>(current.tissues.size());
  info.structures = static_cast<std::uint32_t>(current.segments.size());
  info.tools = static_cast<std::uint32_t>(current.tools.size());
  info.has_scan = current.scan != nullptr;
  return info;
}

plp_tissue tissue_of(const Tissue& tissue) {
  plp_tissue plain{};
  plain.name = tissue.name.c_str();
  plain.touchable = tissue.touchable;
  plain.stiffness_N_per_mm = tissue.stiffness_N_per_mm;
  plain.static_friction = tissue.static_friction;
  plain.friction = tissue.friction;
  plain.viscosity_N_s_per_mm = tissue.viscosity_N_s_per_mm;
  plain.puncture_N = tissue.puncture_N;
  return plain;
}

plp_structure structure_of(const Model& model, const Segment& segment) {
  plp_structure plain{};
  plain.label = segment.id;
  plain.name = segment.name.c_str();
  plain.tissue = segment.id < model.tissue_of_label.size() ? model.tissue_of_label[segment.id] : -1;
  plain.rgb[0] = segment.colour.r;
  plain.rgb[1] = segment.colour.g;
  plain.rgb[2] = segment.colour.b;
  return plain;
}

// signed distance to the nearest surface, and its slope
FieldSample nearest_surface(const Model& model, const Point<Patient>& at) {
  FieldSample sample{std::numeric_limits<double>::infinity(), {}};
  const Surface* nearest = nullptr;
  for (const ContactSurface& contact : model.surfaces) {
    if (contact.surface == nullptr) continue;
    const double distance_mm = contact.surface->distance_mm(at);
    if (distance_mm >= sample.value) continue;
    sample.value = distance_mm;
    nearest = contact.surface.get();
  }
  if (nearest != nullptr) sample.gradient = nearest->outward(at);
  return sample;
}

void sample_points(const Model& model, ForceMethod method, std::span<const double> points_mm, double* values,
                   double* gradients) {
  for (std::size_t n = 0; 3 * n < points_mm.size(); ++n) {
    const Point<Patient> at(points_mm[3 * n], points_mm[3 * n + 1], points_mm[3 * n + 2]);
    const FieldSample sample =
        method == ForceMethod::kProxy ? nearest_surface(model, at) : model.force_field(method).sample(at);
    values[n] = sample.value;
    if (gradients == nullptr) continue;
    for (int axis = 0; axis < 3; ++axis)
      gradients[3 * n + static_cast<std::size_t>(axis)] = sample.gradient[axis];
  }
}

}  // namespace

Result<std::shared_ptr<const Model>> with_methods(const plp_model& model,
                                                  std::span<const ForceMethod> methods) {
  const std::lock_guard lock(model.mutex);
  auto ready =
      prepared_for(model.ready == nullptr ? model.loaded.model : model.ready, methods, {}, cancellable());
  if (ready) model.ready = *ready;
  return ready;
}

}  // namespace palpate::c

using palpate::c::fail;
using palpate::c::guarded;
using palpate::c::is_handle;

plp_status plp_model_create(const plp_labels* labels, const plp_tissue* tissues, size_t tissue_count,
                            const plp_structure* structures, size_t structure_count, const plp_tool* tools,
                            size_t tool_count, const plp_model_options* options, plp_model** model) {
  return guarded([&] {
    if (model == nullptr) return fail(PLP_BAD_INPUT, "model: the place for the result is null");
    *model = nullptr;
    plp_labels volume;
    if (!palpate::c::read(labels, volume)) return PLP_BAD_INPUT;
    plp_model_options settings;
    plp_model_options_init(&settings, sizeof settings);
    if (options != nullptr && !palpate::c::read(options, settings)) return PLP_BAD_INPUT;
    return palpate::c::create(volume, tissues, tissue_count, structures, structure_count, tools, tool_count,
                              settings, model);
  });
}

plp_status plp_model_load(const char* scene, const char* segmentation, const plp_model_options* options,
                          plp_model** model) {
  return guarded([&] {
    if (model == nullptr) return fail(PLP_BAD_INPUT, "model: the place for the result is null");
    *model = nullptr;
    if (scene == nullptr || *scene == '\0') return fail(PLP_BAD_INPUT, "scene: there is no name of a scene");
    plp_model_options settings;
    plp_model_options_init(&settings, sizeof settings);
    if (options != nullptr && !palpate::c::read(options, settings)) return PLP_BAD_INPUT;
    const auto method = palpate::c::method_of(settings.method);
    if (!method) return fail(method.error());
    if (settings.title != nullptr || !std::isinf(settings.max_force_N))
      return fail(PLP_USAGE, "options: a scene has its own title and force limit");

    palpate::SceneSource source{scene};
    if (segmentation != nullptr) source.segmentation = segmentation;
    auto loaded = palpate::load_scene_or_data_set(source, palpate::c::cancellable());
    if (!loaded) return fail(loaded.error());
    auto created = std::make_unique<plp_model>();
    created->method = method->value_or(loaded->scene.force.method);
    auto ready =
        palpate::prepared_with_cache(loaded->model, {&created->method, 1}, palpate::c::cancellable());
    if (!ready) return fail(ready.error());
    created->loaded = *std::move(loaded);
    created->loaded.scene.force.method = created->method;
    created->loaded.model = created->prepared = *std::move(ready);
    *model = created.release();
    return PLP_OK;
  });
}

plp_status plp_model_change(const plp_model* model, size_t tissue, const plp_tissue* properties,
                            plp_model** next) {
  return guarded([&] {
    if (next == nullptr) return fail(PLP_BAD_INPUT, "next: the place for the result is null");
    *next = nullptr;
    plp_tissue values;
    if (!is_handle(model) || !palpate::c::read(properties, values)) return PLP_BAD_INPUT;
    auto versions = palpate::c::changed(*model, tissue, values);
    if (!versions) return fail(versions.error());
    *next = palpate::c::next_of(*model, *std::move(versions));
    return PLP_OK;
  });
}

plp_status plp_model_cut(const plp_model* model, const plp_cut* cuts, size_t count, plp_model** next) {
  return guarded([&] {
    if (next == nullptr) return fail(PLP_BAD_INPUT, "next: the place for the result is null");
    *next = nullptr;
    if (!is_handle(model)) return PLP_BAD_INPUT;
    std::vector<palpate::Cut> swept;
    const auto read = palpate::c::read_array(cuts, count, "cuts", [&](const plp_cut& from) {
      const palpate::Point<palpate::Patient> begin{Eigen::Vector3d(from.from_mm)},
          end{Eigen::Vector3d(from.to_mm)};
      swept.push_back({0, {begin, end, from.radius_mm}});
      return palpate::Result<void>();
    });
    if (!read) return fail(read.error());
    auto versions =
        palpate::next_version({model->loaded.model, model->prepared},
                              {.version = model->current().version + 1, .tissue = palpate::ModelChange::kCut},
                              swept, palpate::c::cancellable());
    if (!versions) return fail(versions.error());
    *next = palpate::c::next_of(*model, *std::move(versions));
    return PLP_OK;
  });
}

void plp_model_destroy(plp_model* model) {
  if (model != nullptr && is_handle(model)) delete model;
}

plp_status plp_model_info_get(const plp_model* model, plp_model_info* info) {
  return guarded([&] {
    if (!is_handle(model) || !palpate::c::write(palpate::c::info_of(*model), info)) return PLP_BAD_INPUT;
    return PLP_OK;
  });
}

plp_status plp_model_tissue(const plp_model* model, size_t index, plp_tissue* tissue) {
  return guarded([&] {
    if (!is_handle(model)) return PLP_BAD_INPUT;
    if (index >= model->current().tissues.size())
      return fail(PLP_BAD_INPUT, "index: there is no tissue " + std::to_string(index));
    return palpate::c::write(palpate::c::tissue_of(model->current().tissues[index]), tissue) ? PLP_OK
                                                                                             : PLP_BAD_INPUT;
  });
}

plp_status plp_model_structure(const plp_model* model, size_t index, plp_structure* structure) {
  return guarded([&] {
    if (!is_handle(model)) return PLP_BAD_INPUT;
    if (index >= model->current().segments.size())
      return fail(PLP_BAD_INPUT, "index: there is no structure " + std::to_string(index));
    const auto structure_record =
        palpate::c::structure_of(model->current(), model->current().segments[index]);
    return palpate::c::write(structure_record, structure) ? PLP_OK : PLP_BAD_INPUT;
  });
}

plp_status plp_model_sample(const plp_model* model, int32_t method, const double* points_mm, size_t count,
                            double* values, double* gradients) {
  return guarded([&] {
    if (!is_handle(model)) return PLP_BAD_INPUT;
    const auto requested = palpate::c::method_of(method);
    if (!requested) return fail(requested.error());
    if (count == 0) return PLP_OK;
    if (points_mm == nullptr || values == nullptr) return fail(PLP_BAD_INPUT, "points or values are null");
    if (count > std::numeric_limits<std::ptrdiff_t>::max() / (3 * sizeof(double)))
      return fail(PLP_BAD_INPUT, "count: more points than memory can hold");
    const palpate::ForceMethod by = requested->value_or(model->method);
    const auto ready = palpate::c::with_methods(*model, {&by, 1});
    if (!ready) return fail(ready.error());
    palpate::c::sample_points(**ready, by, {points_mm, 3 * count}, values, gradients);
    return PLP_OK;
  });
}

plp_status plp_model_labels(const plp_model* model, uint16_t* voxels, size_t count) {
  return guarded([&] {
    if (!is_handle(model)) return PLP_BAD_INPUT;
    const auto& labels = *model->current().labels;
    const palpate::GridGeometry& grid = labels.geometry();
    if (voxels == nullptr || count != grid.voxel_count())
      return fail(PLP_BAD_INPUT, "voxels: give room for " + std::to_string(grid.voxel_count()) + " labels");
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        labels.copy_row(0, j, k, grid.dims[0], voxels + grid.offset(0, j, k));
    return PLP_OK;
  });
}

plp_status plp_model_scan(const plp_model* model, const float** voxels, size_t* count) {
  return guarded([&] {
    if (!is_handle(model)) return PLP_BAD_INPUT;
    if (voxels == nullptr || count == nullptr)
      return fail(PLP_BAD_INPUT, "voxels: the place for the result is null");
    if (model->current().scan == nullptr) return fail(PLP_UNAVAILABLE, "the model has no scan");
    *voxels = model->current().scan->voxels().data();
    *count = model->current().scan->voxels().size();
    return PLP_OK;
  });
}
