#include "palpate/scene/scene.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/new_scene.h"
#include "palpate/scene/script.h"
#include "palpate/scene/tissue_presets.h"

#include <algorithm>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/contact/tissue_values.h"
#include "scene/read_tools.h"
#include "scene/scene_checks.h"
#include "scene/table_reader.h"

namespace palpate {
namespace {

void read_data(const TableReader& data, Scene& scene) {
  if (const auto scan = data.text("scan")) scene.scan = *scan;
  if (const auto volume = data.integer("scan_volume")) scene.scan_volume = static_cast<int>(*volume);
  if (const auto labels = data.text("labels")) scene.labels = *labels;
  if (const auto space = data.choice("mesh_space")) scene.mesh_space = value_of(*space, kSurfaceAxes);
  if (const auto unit = data.choice("mesh_unit")) scene.mesh_unit = value_of(*unit, kSurfaceUnits);
  scene.image_spacing_mm = data.point("image_spacing");
  if (const auto form = data.choice("nifti_form")) scene.nifti_form = value_of(*form, kHeaderForms);
  scene.scan_is_cropped = data.flag("cropped_scan").value_or(false);
  if (const auto names = data.text("names")) scene.names = *names;
  scene.lines = {data.line("scan"), data.line("labels"), data.line("names")};
}

TissueSettings starting_values(const TableReader& reader) {
  const auto preset = reader.choice("preset");
  if (!preset) return {};
  const TissuePreset* found = find_preset(*preset);
  PALPATE_CHECK(found != nullptr);
  return found->values;
}

// elastic constants; a key overrides the preset's value
void read_elastic(const TableReader& reader, TissueSettings& tissue, Problems& problems) {
  if (const auto modulus_kPa = reader.number("youngs_modulus")) {
    if (!tissue.elastic) tissue.elastic.emplace();
    tissue.elastic->youngs_modulus_kPa = *modulus_kPa;
  }
  const auto set = [&](const char* key, const char* what, double ElasticConstants::*member) {
    const auto value = reader.number(key);
    if (!value) return;
    if (tissue.elastic)
      (*tissue.elastic).*member = *value;
    else if (!reader.has("youngs_modulus"))
      problems.add(reader.line(key), "tissue \"" + tissue.name + "\" has " + what + " but no modulus",
                   "add youngs_modulus = 10, in kPa; without it the tissue is rigid");
  };
  set("poissons_ratio", "a Poisson's ratio", &ElasticConstants::poissons_ratio);
  set("stiffening", "a stiffening", &ElasticConstants::stiffening);
}

// relaxation; replaces the preset's
void read_relaxation(const TableReader& reader, TissueSettings& tissue, Problems& problems) {
  const auto terms = reader.terms("relaxation");
  if (!terms) return;
  tissue.relaxation = {};
  const auto wrong = [&](const std::string& what, std::string remedy) {
    problems.add(reader.line("relaxation"), "tissue \"" + tissue.name + "\" " + what, std::move(remedy));
  };
  if (terms->size() > kMaxRelaxationTerms)
    return wrong(
        "relaxes by " + std::to_string(terms->size()) + " terms",
        "a relaxation has at most " + std::to_string(kMaxRelaxationTerms) + " pairs [fraction, time]");
  for (std::size_t n = 0; n < terms->size(); ++n) {
    const auto [part, time_s] = (*terms)[n];
    if (!(part > 0))
      return wrong("relaxes by a fraction of " + number_text(part), "a fraction must be above 0");
    tissue.relaxation.term[n] = {part, time_s};
  }
  if (const double part = tissue.relaxation.total_fraction(); !(part < 1))
    return wrong("relaxes by " + number_text(part) + " of its modulus",
                 "the sum of the fractions must be below 1");
  if (tissue.relaxation.relaxes() && !tissue.elastic && !reader.has("youngs_modulus"))
    wrong("has a relaxation but no modulus",
          "add youngs_modulus = 10, in kPa; without it the tissue is rigid");
}

TissueSettings read_tissue(const TableReader& reader, Problems& problems) {
  TissueSettings tissue = starting_values(reader);
  tissue.line = reader.line();
  tissue.name = reader.text("name").value_or("");
  if (!reader.has("name"))
    problems.add_missing(reader.line(), "a tissue without a name", "add: name = \"...\"");

  // labels
  if (auto labels = reader.labels("labels")) {
    tissue.labels = std::move(labels->references);
    tissue.label_lines = std::move(labels->lines);
  }
  tissue.threshold = reader.interval("threshold");
  tissue.optional = reader.flag("optional").value_or(false);
  tissue.embedding = reader.flag("embedding").value_or(false);
  tissue.air_below = reader.number("air_below");
  const bool by_labels = reader.has("labels"), by_threshold = reader.has("threshold");
  constexpr const char* kEither =
      "a tissue is made of labels, of the scan above a threshold, or, with embedding = true, of the "
      "unlabelled voxels inside the body";
  if (by_labels && by_threshold) {
    problems.add(reader.line(), "tissue \"" + tissue.name + "\" has both labels and a threshold", kEither);
  } else if (tissue.embedding && (by_labels || by_threshold)) {
    problems.add(reader.line("embedding"),
                 "tissue \"" + tissue.name + "\" is an embedding, but has " +
                     (by_labels ? "labels" : "a threshold") + " as well",
                 kEither);
  } else if (!by_labels && !by_threshold && !tissue.embedding) {
    problems.add_missing(reader.line(), "tissue \"" + tissue.name + "\" has neither labels nor a threshold",
                         kEither);
  }
  if (tissue.air_below && !tissue.embedding)
    problems.add(reader.line("air_below"),
                 "tissue \"" + tissue.name + "\" has air_below but is not an embedding",
                 "add: embedding = true, or leave air_below out");
  if (by_threshold && tissue.optional) {
    problems.add(reader.line("optional"), "a tissue with a threshold cannot be optional",
                 "optional applies to labels that may be missing from the map");
  }

  // haptic properties
  const auto set = [&](std::string_view key, double& value) { value = reader.number(key).value_or(value); };
  tissue.touchable = reader.flag("touchable").value_or(tissue.touchable);
  for (const ContactProperty& property : kContactProperties) set(property.key, tissue.*property.value);
  // without a value of its own it is the kinetic coefficient
  if (!reader.has("static_friction")) tissue.static_friction = tissue.friction;
  tissue.puncture_N = reader.number("puncture").value_or(tissue.puncture_N);
  if (const auto after = reader.choice("after_puncture")) tissue.stays_open = *after == "stays_open";
  if (tissue.stays_open && !std::isfinite(tissue.puncture_N))
    problems.add(reader.line("after_puncture"),
                 "tissue \"" + tissue.name + "\" stays open after a puncture, but has no puncture force",
                 "add puncture = 1, in N: the force at which the tool punctures the surface");
  set("cutting_energy", tissue.cutting_energy_mJ_per_mm3);
  if (const auto protection = reader.choice("protection"))
    tissue.protection = *protection == "keep"    ? Protection::kBlock
                        : *protection == "alarm" ? Protection::kAlarm
                                                 : Protection::kNone;
  if (tissue.protection != Protection::kNone && !tissue.touchable)
    problems.add(reader.line("protection"), "tissue \"" + tissue.name + "\" is protected but not touchable",
                 "untouchable tissue is never cut: leave out `protection` or `touchable = false`");
  if (auto fault = friction_fault(tissue))
    problems.add(reader.line("static_friction"), std::move(fault->what), std::move(fault->remedy));
  read_elastic(reader, tissue, problems);
  read_relaxation(reader, tissue, problems);
  set("friction_damping", tissue.friction_damping_N_s_per_mm);
  set("friction_max", tissue.friction_max_N);
  if (const auto names = reader.names("rests_on")) tissue.rests_on = *names;

  // appearance
  if (const auto colour = reader.colour("colour")) tissue.colour = *colour;
  set("opacity", tissue.opacity);
  return tissue;
}

void read_preparation(const TableReader& reader, PreparationSettings& preparation, Problems& problems) {
  if (const auto method = reader.choice("method"))
    preparation.method =
        *method == "union-gaussian" ? PreparationMethod::kUnionGaussian : PreparationMethod::kInwardRamp;
  preparation.ramp_width_mm = reader.number("ramp_width");
  if (preparation.ramp_width_mm && preparation.method != PreparationMethod::kInwardRamp)
    problems.add(reader.line("ramp_width"), "ramp_width belongs to method = \"inward-ramp\"",
                 "take it out, or change the method");
  preparation.sigma_mm = reader.number("sigma").value_or(preparation.sigma_mm);
  if (const auto engine = reader.choice("engine"))
    preparation.engine = *engine == "fourier" ? GaussianEngine::kFourier : GaussianEngine::kDirect;
  if (const auto bits = reader.integer("bits")) {
    if (*bits != 8 && *bits != 16)
      problems.add(reader.line("bits"), "bits = " + std::to_string(*bits) + " is neither 8 nor 16",
                   "bits takes 8 or 16; default 16");
    preparation.storage = *bits == 8 ? FieldStorage::k8Bit : FieldStorage::k16Bit;
  }
}

void read_force(const TableReader& reader, ForceSettings& force) {
  if (const auto method = reader.choice("method")) force.method = *find_force_method(*method);
  force.settings.sphere_sigma_voxels =
      reader.number("sphere_sigma").value_or(force.settings.sphere_sigma_voxels);
  if (const auto normals = reader.choice("normals"))
    force.settings.normals = *normals == "octahedral16"   ? NormalEncoding::kOctahedral16
                             : *normals == "octahedral24" ? NormalEncoding::kOctahedral24
                                                          : NormalEncoding::kBytes;
  force.settings.coupling_damping_N_s_per_mm =
      reader.number("coupling_damping").value_or(force.settings.coupling_damping_N_s_per_mm);
}

// clears the presets' relaxation unless the tissue sets it, so that scenes written before relaxation existed
// behave as before
void clear_preset_relaxation(const TableReader& top, Scene& scene) {
  const auto tables = top.tables("tissue");
  for (std::size_t n = 0; n < scene.tissues.size(); ++n) {
    // errors of this table have already been reported
    Problems problems(scene.source);
    if (!TableReader(tables[n], scene_key_tables().tissue, problems).has("relaxation"))
      scene.tissues[n].relaxation = {};
  }
}

void read_deformation(const TableReader& reader, Scene& scene, Problems& problems) {
  DeformationSettings& deformation = scene.deformation;
  deformation.law = value_of(reader.choice("law").value_or(""), kTissueLaws);
  deformation.cell_mm = reader.number("cell");
  if (is_elastic(deformation.law) && scene.force.method != ForceMethod::kProxy)
    problems.add(reader.line("law"), "tissue yields only with the proxy",
                 "leave [force] method out, or set law = \"layers\" or \"chainmail\"");
  deformation.relaxation = reader.flag("relaxation").value_or(false);
  const auto does_nothing = [&](const char* key, const char* laws) {
    problems.add(reader.line(key), key + std::string(" belongs to the laws ") + laws,
                 "take it out, or change the law");
  };
  if (deformation.relaxation && !is_elastic(deformation.law))
    does_nothing("relaxation", "\"elastic\", \"neo-hookean\" and \"exponential\"");
  if (deformation.cell_mm && !is_moving(deformation.law))
    does_nothing("cell", "\"elastic\", \"neo-hookean\", \"exponential\" and \"chainmail\"");
}

void read_density(const TableReader& reader, Scene& scene, Problems& problems) {
  // attenuation of cortical bone of 1.9 g/cm3 (docs/decisions/0094-density-of-bone.md)
  constexpr double kCortical_HU = 1700;
  const bool calibrated = reader.flag("calibrated").value_or(false);
  const double full_HU = reader.number("full").value_or(kCortical_HU);
  if (calibrated) scene.full_density_HU = full_HU;
  if (!calibrated && reader.has("full"))
    problems.add(reader.line("full"),
                 "[density] has an attenuation, but the scan is not said to be calibrated",
                 "add: calibrated = true, if it is a calibrated CT, or leave the table out");
  if (calibrated && scene.modality == Modality::kMr)
    problems.add(reader.line("calibrated"), "an MR scan has no Hounsfield units",
                 "leave out [density], or correct the modality");
}

void read_workspace(const TableReader& reader, WorkspaceSettings& workspace) {
  const auto set = [&](std::string_view key, double& value) { value = reader.number(key).value_or(value); };
  set("scale", workspace.scale);
  set("force_gain", workspace.force_gain);
  set("yaw", workspace.yaw_deg);
  if (const auto home = reader.point("home")) workspace.home = Point<World>(*home);
  if (const auto button = reader.integer("clutch_button"))
    workspace.clutch_button = static_cast<int>(*button);
}

void read_distances(const TableReader& reader, DistanceSettings& distances) {
  if (const auto structures = reader.choice("structures"))
    distances.structures = *structures == "touchable" ? ReportedStructures::kTouchable
                           : *structures == "all"     ? ReportedStructures::kAll
                                                      : ReportedStructures::kNone;
  distances.reach_mm = reader.number("reach").value_or(distances.reach_mm);
}

// an anatomical direction by name, or a non-zero vector
Vector<Patient> unit_direction(const std::variant<std::string, Eigen::Vector3d>& direction) {
  if (const auto* vector = std::get_if<Eigen::Vector3d>(&direction))
    return Vector<Patient>(vector->normalized());
  const auto& name = std::get<std::string>(direction);
  const auto found = std::find_if(kPatientDirections.begin(), kPatientDirections.end(),
                                  [&](const auto& one) { return one.first == name; });
  PALPATE_CHECK(found != kPatientDirections.end());
  return Vector<Patient>(found->second[0], found->second[1], found->second[2]);
}

NoGoSettings read_no_go(const TableReader& reader, Problems& problems) {
  NoGoSettings region;
  region.line = reader.line();
  region.name = reader.text("name").value_or("");
  if (!reader.has("name"))
    problems.add_missing(reader.line(), "a no-go region without a name", "add: name = \"...\"");
  const std::string named = "no-go region \"" + region.name + "\" ";
  if (auto structures = reader.labels("structures")) {
    region.structures = std::move(structures->references);
    region.structure_lines = std::move(structures->lines);
  }
  region.keep_away_mm = reader.number("keep_away").value_or(region.keep_away_mm);
  region.stiffness_N_per_mm = reader.number("stiffness").value_or(region.stiffness_N_per_mm);

  // shape
  constexpr const char* kEither =
      "a region is made of `structures`, or of a plane (`point` and `outward`), or of a ball (`centre` and "
      "`radius`)";
  const bool is_plane = reader.has("point") || reader.has("outward");
  const bool is_ball = reader.has("centre") || reader.has("radius");
  const int kinds = (reader.has("structures") ? 1 : 0) + (is_plane ? 1 : 0) + (is_ball ? 1 : 0);
  if (kinds > 1) problems.add(reader.line(), named + "is defined in more than one way", kEither);
  if (kinds == 0) problems.add_missing(reader.line(), named + "has no geometry", kEither);
  const auto lacks = [&](const char* key, const char* remedy) {
    if (!reader.has(key)) problems.add_missing(reader.line(), named + "has no `" + key + "`", remedy);
  };
  if (is_plane) {
    lacks("point", "add: point = [x, y, z], in millimetres, LPS");
    lacks("outward", "add: outward = \"superior\", or a vector, LPS");
    const auto point = reader.point("point");
    const auto outward = reader.direction("outward");
    if (point && outward) region.shape = NoGoPlane{Point<Patient>(*point), unit_direction(*outward)};
  }
  if (is_ball) {
    lacks("centre", "add: centre = [x, y, z], in millimetres, LPS");
    lacks("radius", "add: radius = 5, in millimetres");
    const auto centre = reader.point("centre");
    const auto radius_mm = reader.number("radius");
    if (centre && radius_mm) region.shape = NoGoSphere{Point<Patient>(*centre), *radius_mm};
  }
  return region;
}

void read_regions(const TableReader& top, Scene& scene, Problems& problems) {
  const auto tables = top.tables("no_go");
  if (tables.size() > kMaxNoGo) {
    problems.add(tables[kMaxNoGo]->line,
                 std::to_string(tables.size()) + " no-go regions, more than " + std::to_string(kMaxNoGo),
                 "leave some out");
    return;
  }
  for (const TomlTable* table : tables)
    scene.no_go.push_back(read_no_go(TableReader(table, scene_key_tables().no_go, problems), problems));
}

void read_tissues(const TableReader& top, Scene& scene, Problems& problems) {
  const auto tables = top.tables("tissue");
  if (tables.empty()) {
    problems.add_missing(top.line("tissue"), "the scene has no tissue",
                         "add a [[tissue]] with a name and labels");
    return;
  }
  if (tables.size() > kMaxTissues) {
    problems.add(tables[kMaxTissues]->line,
                 std::to_string(tables.size()) + " tissues, more than " + std::to_string(kMaxTissues),
                 "group structures that feel alike into one tissue");
    return;
  }
  for (const TomlTable* table : tables)
    scene.tissues.push_back(read_tissue(TableReader(table, scene_key_tables().tissue, problems), problems));
}

}  // namespace

std::filesystem::path Scene::resolve(const std::filesystem::path& file) const {
  return file.is_absolute() ? file : folder / file;
}

std::string Scene::where(int line) const {
  return source + ":" + std::to_string(line);
}

Result<Scene> parse_scene(std::string_view text, const std::string& source) {
  auto document = parse_toml(text, kMaxSceneBytes, source);
  if (!document) return document.error();

  const TomlValue* step = document->find("step");
  if (step && !document->find("tissue")) {
    return Error{ErrorKind::kBadInput, "this is a palpation script, not a scene",
                 source + ":" + std::to_string(step->line),
                 "give it after the scene: palpate simulate SCENE --script SCRIPT"};
  }

  const SceneKeys& keys = scene_key_tables();
  Problems problems(source);
  Scene scene;
  scene.source = source;
  const TableReader top(&*document, keys.top, problems);
  scene.title = top.text("title").value_or("");
  scene.side = value_of(top.choice("side").value_or(""), kSides);
  scene.modality = value_of(top.choice("modality").value_or(""), kModalities);
  read_data(TableReader(top.table("data"), keys.data, problems), scene);
  read_tissues(top, scene, problems);
  read_preparation(TableReader(top.table("preparation"), keys.preparation, problems), scene.preparation,
                   problems);
  read_force(TableReader(top.table("force"), keys.force, problems), scene.force);
  read_deformation(TableReader(top.table("yielding"), keys.deformation, problems), scene, problems);
  if (!scene.deformation.relaxation) clear_preset_relaxation(top, scene);
  read_density(TableReader(top.table("density"), keys.density, problems), scene, problems);
  read_tools(top, scene, problems);
  read_workspace(TableReader(top.table("workspace"), keys.workspace, problems), scene.workspace);
  scene.max_force_N = TableReader(top.table("limits"), keys.limits, problems).number("max_force");
  read_distances(TableReader(top.table("distances"), keys.distances, problems), scene.distances);
  read_regions(top, scene, problems);
  if (problems.any()) return problems.first();

  // checks across tables; the later ones rely on unique names
  check_names(scene, problems);
  if (top.has("data")) check_volumes(scene, top.line("data"), problems);
  if (problems.any()) return problems.first();
  check_support_cycles(scene, problems);
  if (problems.any()) return problems.first();
  check_stiffness_order(scene, problems);
  if (problems.any()) return problems.first();
  return scene;
}

Result<Scene> load_scene(const std::filesystem::path& file) {
  const auto text = read_file(file, kMaxSceneBytes);
  if (!text) return text.error();
  auto scene = parse_scene(*text, file.string());
  if (!scene) return scene.error();
  if (!scene->scan && !scene->labels) {
    return Error{ErrorKind::kBadInput, "the scene names no data", file.string(),
                 "add a [data] table with labels = \"...\", or scan = \"...\""};
  }
  scene->folder = file.parent_path();
  if (auto found = check_files(*scene); !found) return found.error();
  return scene;
}

Result<void> write_scene_text(const std::filesystem::path& file, std::string_view text) {
  return write_file(file, text);
}

}  // namespace palpate
