#include "palpate/scene/scene.h"

#include <algorithm>
#include <span>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/base/reading.h"
#include "palpate/contact/tissue_values.h"
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

SupportValues support_values(const TissueSettings& tissue) {
  return {tissue.name, tissue.stiffness_N_per_mm, tissue.touchable};
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
                   "add youngs_modulus = 10, in kPa; without it the tissue does not yield");
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
          "add youngs_modulus = 10, in kPa; without it the tissue does not yield");
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

void read_capsule(const TomlTable& table, const TableSpec& keys, Tool& tool, Problems& problems) {
  const TableReader reader(&table, keys, problems);
  const auto from = reader.point("from"), to = reader.point("to");
  for (const char* end : {"from", "to"})
    if (!reader.has(end))
      problems.add_missing(reader.line(), std::string("a capsule without `") + end + "`",
                           std::string("add: ") + end + " = [x, y, z], in millimetres from the tip");
  if (!from || !to) return;
  constexpr double kMinLength_mm = 0.1;
  if ((*to - *from).norm() < kMinLength_mm) {
    problems.add(reader.line("to"), "a capsule whose ends are less than 0.1 mm apart",
                 "move one end, or write a point");
    return;
  }
  tool.capsules.push_back({*from, *to, reader.number("radius").value_or(tool.radius_mm)});
}

// length in millimetres for messages
std::string in_mm(double mm) {
  char text[32];
  std::snprintf(text, sizeof text, "%g mm", mm);
  return text;
}

// dimensions of a cylinder or cone besides its `diameter`: the row of spheres from its tip to its far end
void read_row(const TableReader& reader, bool is_cone, Tool& tool, BurrSettings& burr, Problems& problems) {
  const std::string shape = is_cone ? "cone" : "cylinder";
  const auto length_mm = reader.number("length"), tip_mm = reader.number("tip_diameter");
  if (!reader.has("length"))
    problems.add_missing(reader.line("shape"), "a " + shape + " without `length`",
                         "add: length = 8, in millimetres from its tip to its far end");
  if (is_cone && !reader.has("tip_diameter"))
    problems.add_missing(reader.line("shape"), "a cone without `tip_diameter`",
                         "add: tip_diameter = 1.2, in millimetres; `diameter` applies to its far end");
  if (!is_cone && reader.has("tip_diameter"))
    problems.add(reader.line("tip_diameter"), "a cylinder has no `tip_diameter`",
                 "it is as wide at its tip: leave this out, or write shape = \"cone\"");
  if (!length_mm || (is_cone && !tip_mm)) return;
  const double end_mm = 2 * tool.radius_mm, first_mm = is_cone ? *tip_mm : end_mm;
  if (is_cone && first_mm == end_mm) {
    problems.add(reader.line("tip_diameter"), "a cone as wide at its tip as at its far end",
                 "write shape = \"cylinder\" and leave `tip_diameter` out, or change one of them");
    return;
  }
  // one end sphere would contain the other
  const double widest_mm = std::max(first_mm, end_mm);
  if (*length_mm <= widest_mm) {
    problems.add(
        reader.line("length"),
        "a " + shape + " of " + in_mm(widest_mm) + " that is " + in_mm(*length_mm) + " long",
        "with its round ends it is longer than wide: make `length` larger, or write shape = \"ball\"");
    return;
  }
  tool.radius_mm = 0.5 * first_mm;
  burr.end_radius_mm = 0.5 * end_mm;
  burr.length_mm = *length_mm - 0.5 * (first_mm + end_mm);
}

// reads a burr, or a shaver: a burr that turns slowly and cuts soft tissue
void read_burr(const TableReader& reader, bool is_shaver, Tool& tool, Problems& problems) {
  BurrSettings burr;
  burr.shaver = is_shaver;
  constexpr double kSecondsPerMinute = 60;
  // resection rate of tendon and meniscus is best at 5.5 mm and 2000 to 2500 1/min (docs/guide/burr.md)
  constexpr double kShaver_mm = 5.5, kShaverSpeed_per_min = 2500, kBurr_mm = 4;
  constexpr int kShaverFlutes = 2;
  const std::string kind = is_shaver ? "shaver" : "burr";
  for (const char* key : {"points", "radius", "capsule"})
    if (reader.has(key))
      problems.add(reader.line(key), "a " + kind + " has no `" + key + "`",
                   "a burr is defined by the shape of its head: give its diameter, and leave this out");
  tool.radius_mm = 0.5 * reader.number("diameter").value_or(is_shaver ? kShaver_mm : kBurr_mm);
  if (is_shaver) {
    if (!reader.has("name")) tool.name = kind;
    burr.revolutions_per_s = kShaverSpeed_per_min / kSecondsPerMinute;
    burr.flutes = kShaverFlutes;
  }
  const std::string shape = std::string(reader.choice("shape").value_or("ball"));
  if (is_shaver && shape == "cone")
    problems.add(reader.line("shape"), "a shaver cannot be a cone",
                 "write shape = \"cylinder\" or shape = \"ball\", or kind = \"burr\"");
  if (shape != "ball") read_row(reader, shape == "cone", tool, burr, problems);
  for (const char* key : {"length", "tip_diameter"})
    if (shape == "ball" && reader.has(key))
      problems.add(reader.line(key), std::string("a ball has no `") + key + "`",
                   "leave this out, or write shape = \"cylinder\" or shape = \"cone\"");
  if (const auto speed = reader.number("speed")) burr.revolutions_per_s = *speed / kSecondsPerMinute;
  burr.grip = reader.number("grip").value_or(burr.grip);
  if (const auto flutes = reader.integer("flutes")) burr.flutes = static_cast<int>(*flutes);
  burr.irrigation = reader.flag("irrigation").value_or(burr.irrigation);
  if (const auto pedal = reader.integer("pedal")) burr.pedal = static_cast<int>(*pedal);
  if (const auto spindle = reader.point("spindle")) {
    constexpr double kMinNorm = 1e-3;
    if (spindle->norm() < kMinNorm)
      problems.add(reader.line("spindle"), "the spindle has no direction",
                   "write spindle = [x, y, z], such as [0, 0, 1]");
    else
      burr.spindle = spindle->normalized();
  }
  tool.burr = burr;
}

void read_parts(const TableReader& reader, const TableSpec& capsule, Tool& tool, Problems& problems) {
  for (const char* key : {"shape", "diameter", "length", "tip_diameter", "speed", "spindle", "grip", "flutes",
                          "irrigation", "pedal"})
    if (reader.has(key))
      problems.add(reader.line(key), std::string("`") + key + "` is a key of burrs",
                   "add kind = \"burr\" or kind = \"shaver\", or leave this out");
  tool.radius_mm = reader.number("radius").value_or(tool.radius_mm);
  tool.points_mm = reader.points("points").value_or(tool.points_mm);
  if (tool.points_mm.empty() || tool.points_mm.size() > kMaxToolParts) {
    problems.add(reader.line("points"), "points has " + std::to_string(tool.points_mm.size()) + " points",
                 "a tool has 1 to " + std::to_string(kMaxToolParts) + " points");
    return;
  }
  for (const TomlTable* table : reader.tables("capsule")) read_capsule(*table, capsule, tool, problems);
  if (const std::size_t parts = tool.points_mm.size() + tool.capsules.size(); parts > kMaxToolParts)
    problems.add(
        reader.line("capsule"), "the tool has " + std::to_string(parts) + " points and capsules",
        "together they may be " + std::to_string(kMaxToolParts) + "; without `points` the tip is one point");
}

struct ReadTool {
  Tool tool;
  bool is_shaver = false;
};

// reads a tool; without a table it is a point
ReadTool read_tool(const TomlTable* table, const TableSpec& keys, const TableSpec& capsule,
                   ForceMethod method, Problems& problems) {
  Tool tool;
  const TableReader reader(table, keys, problems);
  tool.name = reader.text("name").value_or(tool.name);
  const auto kind = reader.choice("kind");
  const bool is_shaver = kind == "shaver";
  if (kind == "burr" || is_shaver)
    read_burr(reader, is_shaver, tool, problems);
  else
    read_parts(reader, capsule, tool, problems);
  if (tool.burr && method != ForceMethod::kProxy)
    problems.add(reader.line("kind"), std::string(is_shaver ? "a shaver" : "a burr") + " requires the proxy",
                 "set [force] method = \"proxy\", or leave method out");
  return {std::move(tool), is_shaver};
}

// A shaver cuts tissues that have a modulus or an explicit cutting energy; others, such as bone, are
// protected from it. Protection applies to a structure regardless of the tool, so with a burr as the other
// tool the scene has to set it explicitly.
void protect_from_shavers(const TableReader& top, std::span<const ReadTool> tools, Scene& scene,
                          Problems& problems) {
  // cutting energy of soft tissue: 1 kJ/m2, the toughness of cartilage, in slices of 0.2 mm
  // (docs/guide/burr.md)
  constexpr double kSoft_mJ_per_mm3 = 5;
  const auto any = [&](bool is_shaver) {
    return std::any_of(tools.begin(), tools.end(),
                       [&](const ReadTool& read) { return read.tool.burr && read.is_shaver == is_shaver; });
  };
  if (!any(true)) return;
  const auto tables = top.tables("tissue");
  for (std::size_t n = 0; n < scene.tissues.size(); ++n) {
    TissueSettings& tissue = scene.tissues[n];
    // errors of this table have already been reported
    Problems step_problems(scene.source);
    const TableReader reader(tables[n], scene_key_tables().tissue, step_problems);
    if (reader.has("cutting_energy")) continue;
    if (tissue.elastic) {
      tissue.cutting_energy_mJ_per_mm3 = kSoft_mJ_per_mm3;
    } else if (tissue.touchable && !reader.has("protection")) {
      if (any(false))
        problems.add_missing(
            tissue.line,
            "tissue \"" + tissue.name + "\" cannot be cut by a shaver, but one of the tools is a burr",
            "add protection = \"keep\", so that neither cuts it, or \"none\", so that both do");
      tissue.protection = Protection::kBlock;
    }
  }
}

void read_tools(const TableReader& top, Scene& scene, Problems& problems) {
  const SceneKeys& keys = scene_key_tables();
  std::vector<ReadTool> read{
      read_tool(top.table("tool"), keys.tool, keys.capsule, scene.force.method, problems)};
  if (top.has("second_tool")) {
    Problems of_second(scene.source);
    read.push_back(read_tool(top.table("second_tool"), keys.second_tool, keys.second_capsule,
                             scene.force.method, of_second));
    problems.add_from(of_second, keys.second_tool.heading);
  }
  protect_from_shavers(top, read, scene, problems);
  scene.tools.clear();
  for (ReadTool& one : read) scene.tools.push_back(std::move(one.tool));
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

/// The index of a tissue by name, or -1.
int index_of(const std::vector<TissueSettings>& tissues, const std::string& name) {
  for (std::size_t i = 0; i < tissues.size(); ++i) {
    if (tissues[i].name == name) return static_cast<int>(i);
  }
  return -1;
}

void check_names(const Scene& scene, Problems& problems) {
  std::vector<std::string_view> all;
  std::string list;
  for (const auto& tissue : scene.tissues) {
    all.push_back(tissue.name);
    list += (list.empty() ? "" : ", ") + tissue.name;
  }
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    const TissueSettings& tissue = scene.tissues[i];
    const TissueSettings& first =
        scene.tissues[static_cast<std::size_t>(index_of(scene.tissues, tissue.name))];
    if (&first != &tissue) {
      problems.add(
          tissue.line,
          "a second tissue \"" + tissue.name + "\"; the first is on line " + std::to_string(first.line),
          "give every tissue a name of its own");
    }
    const auto unknown =
        std::find_if(tissue.rests_on.begin(), tissue.rests_on.end(),
                     [&](const std::string& name) { return index_of(scene.tissues, name) < 0; });
    if (unknown != tissue.rests_on.end()) {
      problems.add(
          tissue.line,
          "tissue \"" + tissue.name + "\" rests on \"" + *unknown + "\", which is not a tissue of this scene",
          did_you_mean(*unknown, all, "\"") + "the tissues are " + list);
    }
  }
}

/// Depth-first search for a cycle among the supports of a tissue; `path` is the chain of ancestors.
bool check_cycle(const Scene& scene, int index, std::vector<int>& path, std::vector<bool>& done,
                 Problems& problems) {
  const auto begin = std::find(path.begin(), path.end(), index);
  const TissueSettings& tissue = scene.tissues[static_cast<std::size_t>(index)];
  if (begin != path.end()) {
    std::string circle;
    for (auto i = begin; i != path.end(); ++i)
      circle += scene.tissues[static_cast<std::size_t>(*i)].name + " on ";
    problems.add(tissue.line, "rests_on is circular: " + circle + tissue.name,
                 "remove one of them, so that one tissue rests on no other");
    return false;
  }
  if (done[static_cast<std::size_t>(index)]) return true;
  path.push_back(index);
  for (const std::string& name : tissue.rests_on) {
    if (!check_cycle(scene, index_of(scene.tissues, name), path, done, problems)) return false;
  }
  path.pop_back();
  done[static_cast<std::size_t>(index)] = true;
  return true;
}

void check_stiffness_order(const Scene& scene, Problems& problems) {
  for (const TissueSettings& tissue : scene.tissues) {
    if (!tissue.touchable) continue;
    for (const std::string& name : tissue.rests_on)
      if (auto fault = support_fault(
              support_values(tissue),
              support_values(scene.tissues[static_cast<std::size_t>(index_of(scene.tissues, name))])))
        problems.add(tissue.line, std::move(fault->what), std::move(fault->remedy));
  }
}

/// Checks that the volume each tissue is derived from is given.
void check_volumes(const Scene& scene, int data_line, Problems& problems) {
  if (scene.scan_volume && !scene.scan)
    problems.add(data_line, "[data] has a scan_volume but no scan", "add: scan = \"...\"");
  if ((scene.mesh_space || scene.mesh_unit) && !scene.labels)
    problems.add(data_line, "[data] has settings for surfaces but names no labels", "add: labels = \"...\"");
  if (!scene.scan && !scene.labels) {
    problems.add(data_line, "[data] names neither a scan nor labels",
                 "add: labels = \"...\", or scan = \"...\"");
    return;
  }
  if (scene.full_density_HU && !scene.scan)
    problems.add(data_line, "[density] needs a scan, and the scene has none",
                 "add to [data]: scan = \"...\", or leave out [density]");
  if (scene.names && !scene.labels)
    problems.add(data_line, "[data] has names for labels but no labels", "add: labels = \"...\"");
  for (const TissueSettings& tissue : scene.tissues) {
    if (tissue.threshold && !scene.scan)
      problems.add(tissue.line, "tissue \"" + tissue.name + "\" has a threshold, but the scene has no scan",
                   "add to [data]: scan = \"...\"");
    if (tissue.air_below && !scene.scan)
      problems.add(tissue.line, "tissue \"" + tissue.name + "\" has air_below, but the scene has no scan",
                   "add to [data]: scan = \"...\"");
    if (tissue.embedding && !scene.labels)
      problems.add(tissue.line,
                   "tissue \"" + tissue.name + "\" embeds labels, but the scene has no label map",
                   "add to [data]: labels = \"...\", or give the tissue a threshold");
    if (tissue.embedding && std::ranges::count_if(scene.tissues, &TissueSettings::embedding) > 1)
      problems.add(tissue.line, "more than one tissue is an embedding", "keep one of them");
    if (!tissue.labels.empty() && !scene.labels)
      problems.add(tissue.line, "tissue \"" + tissue.name + "\" has labels, but the scene has no label map",
                   "add to [data]: labels = \"...\", or give the tissue a threshold");
  }
  for (const NoGoSettings& region : scene.no_go)
    if (!region.structures.empty() && !scene.labels)
      problems.add(region.line,
                   "no-go region \"" + region.name + "\" has structures, but the scene has no label map",
                   "add to [data]: labels = \"...\", or make it a plane or a ball");
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

bool says_elsewhere(const std::filesystem::path& file) {
  return file.is_absolute() || std::find(file.begin(), file.end(), "..") != file.end();
}

/// Checks that the files exist and do not leave the scene's folder through a link. Their contents are checked
/// by their readers.
Result<void> check_files(const Scene& scene) {
  const std::array<std::pair<const std::optional<std::filesystem::path>&, int>, 3> files{
      {{scene.scan, scene.lines.scan}, {scene.labels, scene.lines.labels}, {scene.names, scene.lines.names}}};
  for (const auto& [file, line] : files) {
    if (!file) continue;
    std::error_code unknown;
    const std::filesystem::path path = scene.resolve(*file);
    if (std::filesystem::status(path, unknown).type() == std::filesystem::file_type::not_found)
      return Error{ErrorKind::kBadInput, "no such file: " + path.string(), scene.where(line),
                   "paths are absolute, or relative to the folder of the scene file"};
    // a path that leaves the folder explicitly is allowed; the target of a link is not
    if (says_elsewhere(*file)) continue;
    if (auto stays = check_stays_in(scene.folder, path); !stays) return stays.error();
  }
  return {};
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
  std::vector<bool> done(scene.tissues.size(), false);
  for (std::size_t i = 0; i < scene.tissues.size(); ++i) {
    std::vector<int> path;
    if (!check_cycle(scene, static_cast<int>(i), path, done, problems)) return problems.first();
  }
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
