#include "scene/keys.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <numeric>

#include "palpate/contact/tissue_values.h"
#include "palpate/scene/scene.h"
#include "palpate/surfaces/ramps.h"

namespace palpate {
namespace {

using enum KeyType;

std::string concat(std::initializer_list<std::string_view> parts) {
  std::string text;
  for (const std::string_view part : parts) text += part;
  return text;
}

template <class T, std::size_t kCount>
std::vector<std::string_view> names_of(const std::array<Word<T>, kCount>& words) {
  std::vector<std::string_view> names;
  for (const Word<T>& word : words) names.push_back(word.name);
  return names;
}

// key of a contact property; its default is that of ContactProperties
KeySpec contact_key(double ContactProperties::*value, std::string_view meaning) {
  static const auto kDefaults = [] {
    std::array<std::string, kContactProperties.size()> texts;
    for (std::size_t n = 0; n < texts.size(); ++n)
      texts[n] = number_text(ContactProperties{}.*kContactProperties[n].value);
    return texts;
  }();
  const ContactProperty& property = contact_property(value);
  // static friction follows the scene's friction
  const bool has_default = value != &ContactProperties::static_friction;
  return {.name = property.key,
          .type = kNumber,
          .default_text = has_default
                              ? kDefaults[static_cast<std::size_t>(&property - kContactProperties.data())]
                              : std::string_view(),
          .unit = property.unit,
          .min = property.range.min,
          .max = property.range.max,
          .meaning = meaning};
}

std::string default_cell(const KeySpec& key) {
  if (key.type == kTable || key.type == kTables) return "";
  return key.default_text.empty() ? "—" : concat({"`", key.default_text, "`"});
}

std::string value_cell(const KeySpec& key) {
  if (key.choices.empty()) return std::string(type_text(key.type));
  std::string text;
  for (const std::string_view choice : key.choices)
    text += concat({text.empty() ? "" : ", ", "`\"", choice, "\"`"});
  return key.type == kDirection ? text + " or [x, y, z]" : text;
}

std::string range_cell(const KeySpec& key) {
  if (!key.has_range() || key.type == kDirection || key.type == kPlace) return "";
  return concat({number_text(key.min), " … ", number_text(key.max)});
}

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

/// Number of edits (insert, delete, replace, swap two neighbours) that turn a into b, ignoring case, with at
/// most one edit per letter (optimal string alignment distance).
int edit_distance(std::string_view a, std::string_view b) {
  std::vector<int> before(b.size() + 1), row(b.size() + 1), next(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 0; i < a.size(); ++i) {
    next[0] = static_cast<int>(i) + 1;
    for (std::size_t j = 0; j < b.size(); ++j) {
      const bool equal = lower(a[i]) == lower(b[j]);
      next[j + 1] = std::min({row[j] + (equal ? 0 : 1), row[j + 1] + 1, next[j] + 1});
      const bool swapped = i > 0 && j > 0 && lower(a[i]) == lower(b[j - 1]) && lower(a[i - 1]) == lower(b[j]);
      if (swapped) next[j + 1] = std::min(next[j + 1], before[j - 1] + 1);
    }
    std::swap(before, row);
    std::swap(row, next);
  }
  return row.back();
}

/// Wraps a paragraph at 120 columns, the line width of the manual.
std::string in_lines(std::string_view text) {
  constexpr std::size_t kWidth = 120;
  std::string lines;
  std::size_t column = 0;
  while (!text.empty()) {
    const std::string_view word = text.substr(0, text.find(' '));
    text.remove_prefix(std::min(word.size() + 1, text.size()));
    if (column > 0) {
      const bool fits = column + 1 + word.size() <= kWidth;
      lines += fits ? ' ' : '\n';
      column = fits ? column + 1 : 0;
    }
    lines += word;
    column += word.size();
  }
  return lines;
}

std::vector<std::string_view> method_names() {
  std::vector<std::string_view> names;
  for (const ForceMethodInfo& info : kForceMethods) names.push_back(info.name);
  return names;
}

}  // namespace

std::string table_markdown(const TableSpec& table) {
  std::string text = concat({"### ", table.heading, "\n\n", in_lines(table.about), "\n\n"});
  text += "| key | value | default | unit | range | meaning |\n|---|---|---|---|---|---|\n";
  for (const KeySpec& key : table.keys) {
    text += concat({"| `", key.name, "` | ", value_cell(key), " | ", default_cell(key), " | ", key.unit,
                    " | ", range_cell(key), " | ", key.meaning, " |\n"});
  }
  return text;
}

const KeySpec* TableSpec::find(std::string_view key) const {
  const auto found = std::find_if(keys.begin(), keys.end(), [&](const KeySpec& k) { return k.name == key; });
  return found == keys.end() ? nullptr : &*found;
}

namespace {

// the keys of one tool
SceneKeys declared_keys() {
  return {
      .top =
          {"top level",
           "What the scene is, and its parts.",
           {{.name = "title",
             .type = kText,
             .meaning = "Shown in the report; say nothing in it that names a patient."},
            {.name = "side",
             .type = kChoice,
             .default_text = "\"unknown\"",
             .choices = names_of(kSides),
             .meaning =
                 "Side of the body, shown in the report; `\"both\"` for a head or a torso. Without it a "
                 "leg's side follows from its fibula ([scene.md](../guide/scene.md#which-side))."},
            {.name = "modality",
             .type = kChoice,
             .default_text = "\"unknown\"",
             .choices = names_of(kModalities),
             .meaning =
                 "What made the scan. The viewer shows a CT's values as HU, with windows for them. Without "
                 "it a scan that has values of -500 and below is a CT, and any other unknown."},
            {.name = "data", .type = kTable, .meaning = "The files. A scene file has to have it."},
            {.name = "tissue", .type = kTables, .meaning = "What is felt and how: 1 to 64 of them."},
            {.name = "preparation", .type = kTable, .meaning = "How labels become the field that is felt."},
            {.name = "force", .type = kTable, .meaning = "By which method the force is computed."},
            {.name = "yielding", .type = kTable, .meaning = "Whether soft tissue gives way to the tool."},
            {.name = "tool", .type = kTable, .meaning = "The instrument that every device holds."},
            {.name = "second_tool",
             .type = kTable,
             .meaning =
                 "What the second device holds instead: a table with the keys of `[tool]` and the "
                 "defaults that they have there. Without it that device holds the same as the others."},
            {.name = "workspace", .type = kTable, .meaning = "How the device's reach lies in the patient."},
            {.name = "limits", .type = kTable, .meaning = "What the hand is never given more of."},
            {.name = "distances", .type = kTable, .meaning = "Of what the tool's distances are told."},
            {.name = "no_go", .type = kTables, .meaning = "Regions that the tool is kept away from."}}},
      .data =
          {"[data]",
           "The files, relative to the scene file's folder or absolute. At least one of `scan` and `labels`.",
           {{.name = "scan",
             .type = kFile,
             .meaning =
                 "The image: NRRD, NIfTI or MetaImage, or a folder of DICOM or a file of it, or a stack of "
                 "pictures."},
            {.name = "scan_volume",
             .type = kWhole,
             .min = 1,
             .max = 100000,
             .meaning = "Which volume, where DICOM holds several: its number as `palpate info` lists them. "
                        "Without it: the only one that can be used."},
            {.name = "labels",
             .type = kFile,
             .meaning =
                 "The segmentation on it, in the same formats or `.seg.nrrd`; or surfaces (STL, OBJ, "
                 "PLY, VTK polydata), a file or a folder with one for each structure; or a folder with a "
                 "mask for each."},
            {.name = "mesh_space",
             .type = kChoice,
             .choices = names_of(kSurfaceAxes),
             .meaning = "What the axes of surfaces are. Without it what their file says, else what the scan "
                        "proves."},
            {.name = "mesh_unit",
             .type = kChoice,
             .choices = names_of(kSurfaceUnits),
             .meaning = "What the numbers of surfaces are in. Without it what the scan proves, else mm."},
            {.name = "image_spacing",
             .type = kPoint,
             .unit = "mm",
             .min = 1e-4,
             .max = 100,
             .meaning =
                 "Between the columns, the rows and the slices of a stack of pictures (PNG, TIFF, JPEG), "
                 "which do not say it."},
            {.name = "nifti_form",
             .type = kChoice,
             .choices = names_of(kHeaderForms),
             .meaning =
                 "Which placement of a NIfTI counts that has a qform and an sform. Without it the sform."},
            {.name = "cropped_scan",
             .type = kFlag,
             .default_text = "false",
             .meaning =
                 "`true`: the scan shows a part of what is labelled, so that more than half of the labels "
                 "may lie outside it."},
            {.name = "names",
             .type = kFile,
             .meaning = "Names and colours of the labels: Slicer's `.ctbl`, `.tsv`, `.csv`, `.json`, "
                        "ITK-SNAP's `.label`. "
                        "Without it the names in the label file count, else those of a table beside it."}}},
      .tissue =
          {"[[tissue]]",
           "A group of structures that feel alike. Takes one of `labels`, `threshold` and `embedding`. A "
           "preset gives the "
           "starting values, keys beside it override them; the defaults here hold without one. A tissue may "
           "not be stiffer than one that it rests on, nor rest on one that is not felt: the force at their "
           "border would point inward.",
           {{.name = "name",
             .type = kText,
             .meaning = "Unique in the scene; `rests_on` refers to it. Has to be there."},
            {.name = "preset",
             .type = kChoice,
             .choices = {"bone", "cartilage", "meniscus", "disc", "ligament", "muscle", "fat", "skin",
                         "vessel", "nerve", "liver", "kidney", "spleen", "lung", "heart", "brain", "gland",
                         "lymph node", "tumour"},
             .meaning = "Starting values ([presets.md](presets.md))."},
            {.name = "labels",
             .type = kLabels,
             .min = 1,
             .max = 65535,
             .meaning =
                 "The structures, by name exactly as the names have them, or by number. A name takes every "
                 "structure so named; no structure belongs to two tissues."},
            {.name = "optional",
             .type = kFlag,
             .default_text = "false",
             .meaning =
                 "`true`: labels that the map does not have only drop out, instead of being an error."},
            {.name = "threshold",
             .type = kInterval,
             .unit = "the scan's unit",
             .min = -1e9,
             .max = 1e9,
             .meaning = "`[low, high]` on the raw scan, without labels: the structure is what reaches their "
                        "middle. To the union Gaussian it is nothing at or below `low`, all at or above "
                        "`high`, a ramp between."},
            {.name = "embedding",
             .type = kFlag,
             .default_text = "false",
             .meaning =
                 "`true`: the tissue is made of the unlabelled voxels inside the body, so that organs do "
                 "not hang in nothing. The body is what is labelled, what the scan connects to that by "
                 "`air_below`, and what they enclose in space or in an axial slice. One tissue at most."},
            {.name = "air_below",
             .type = kNumber,
             .unit = "the scan's unit",
             .min = -1e9,
             .max = 1e9,
             .meaning =
                 "Of an embedding: value of the scan that parts air from the body. Without it only what "
                 "labels enclose is inside."},
            {.name = "felt", .type = kFlag, .default_text = "true", .meaning = "`false`: shown, not felt."},
            contact_key(&ContactProperties::stiffness_N_per_mm,
                        "Force for each mm of depth. Of inward ramps from the surface on; of a union "
                        "Gaussian at the surface, where it rises most steeply "
                        "([scene.md](../guide/scene.md#what-stiffness-means))."),
            contact_key(
                &ContactProperties::friction,
                "Coefficient: the force along the surface is at most this times the force across it."),
            contact_key(&ContactProperties::static_friction,
                        "Of the proxy: coefficient up to which it sticks; at least `friction`, which it has "
                        "without it."),
            {.name = "puncture",
             .type = kNumber,
             .unit = "N",
             .min = 0.05,
             .max = 40,
             .meaning = "Of the proxy: force at which the tool goes through; without it, never."},
            {.name = "after_puncture",
             .type = kChoice,
             .default_text = "\"closes\"",
             .choices = {"closes", "stays_open"},
             .meaning =
                 "Of a tissue with `puncture`. `closes`: behind the tool, so that the next one needs the "
                 "force again. `stays_open`: a tool that is no wider goes in there without force."},
            {.name = "cutting_energy",
             .type = kNumber,
             .default_text = "100",
             .unit = "mJ/mm³",
             .min = 1,
             .max = 10000,
             .meaning = "Of a burr: what its motor works to take a cubic millimetre away. Where a tool is a "
                        "shaver, tissue with a modulus has 5 by default."},
            {.name = "protection",
             .type = kChoice,
             .default_text = "\"none\"",
             .choices = {"none", "alarm", "keep"},
             .meaning =
                 "Of what a burr comes to. `alarm`: it is cut, and that is said. `keep`: the burr is held "
                 "out of it."},
            {.name = "youngs_modulus",
             .type = kNumber,
             .unit = "kPa",
             .min = kElasticModulusRange.min_kPa,
             .max = kElasticModulusRange.max_kPa,
             .meaning = "Of `[yielding] law = \"elastic\"`, without effect under another law: how stiff the "
                        "material is. A tissue that has none, by itself or by its preset, does not yield, "
                        "as bone."},
            {.name = "poissons_ratio",
             .type = kNumber,
             .default_text = "0.45",
             .min = 0,
             .max = kMaxPoissonsRatio,
             .meaning =
                 "Of the same law: how much the material widens where it is pressed; near 0.5 it keeps "
                 "its volume. Only beside a modulus, this key's or the preset's."},
            {.name = "relaxation",
             .type = kTerms,
             .unit = "s",
             .min = kRelaxationTimeRange.min_s,
             .max = kRelaxationTimeRange.max_s,
             .meaning =
                 "Of the same law: how the force falls while it is held. One or two pairs: the part of the "
                 "modulus that is lost, together below 1, and the time in which it is, but for 1/e of it. "
                 "The "
                 "modulus is then what it has at once. Without it, and with `[]`, nothing is lost, but see "
                 "`[yielding] relaxation`. Only beside a modulus."},
            {.name = "friction_damping",
             .type = kNumber,
             .default_text = "0.005",
             .unit = "N·s/mm",
             .min = 0,
             .max = 0.1,
             .meaning = "Of the other methods: force along the surface for each mm/s, below its two caps."},
            {.name = "friction_max",
             .type = kNumber,
             .default_text = "0.5",
             .unit = "N",
             .min = 0,
             .max = 10,
             .meaning = "Of the other methods: the other cap of the force along the surface."},
            contact_key(&ContactProperties::viscosity_N_s_per_mm, "Force against each mm/s inside."),
            {.name = "colour",
             .type = kColour,
             .meaning = "`\"#rrggbb\"`; without it the structures keep their own."},
            {.name = "opacity",
             .type = kNumber,
             .default_text = "1",
             .min = 0,
             .max = 1,
             .meaning = "In pictures: 0 unseen, 1 solid."},
            {.name = "rests_on",
             .type = kNames,
             .default_text = "[]",
             .meaning = "Tissues of this scene that support this one. They have to be felt and at least as "
                        "stiff."}}},
      .preparation = {"[preparation]",
                      "What the direct methods feel: ramps that begin at every structure's own surface, or, "
                      "as published, the labels weighted by stiffness and smoothed together.",
                      {{.name = "method",
                        .type = kChoice,
                        .default_text = "\"inward-ramp\"",
                        .choices = {"inward-ramp", "union-gaussian"},
                        .meaning =
                            "The ramp is 0 outside the voxels of every structure and rises inside with "
                            "the depth. The Gaussian grows structures and fills narrow gaps."},
                       {.name = "ramp_width",
                        .type = kNumber,
                        .default_text = "4",
                        .unit = "mm",
                        .min = kMinRampWidth_mm,
                        .max = kMaxRampWidth_mm,
                        .meaning =
                            "Of the inward ramp: depth at which the stiffest tissue gives its full "
                            "force, `stiffness` times this. At least two of the widest voxels, which it "
                            "has without this key where they are more."},
                       {.name = "sigma",
                        .type = kNumber,
                        .default_text = "1",
                        .unit = "mm",
                        .min = 0,
                        .max = 10,
                        .meaning = "Width of the union Gaussian, the same on every axis, and of the smooth "
                                   "sphere. Wider is softer and calmer and loses what is thin."},
                       {.name = "engine",
                        .type = kChoice,
                        .default_text = "\"direct\"",
                        .choices = {"direct", "fourier"},
                        .meaning = "Of the union Gaussian: separable convolution, or the filter in the "
                                   "frequency domain as published."},
                       {.name = "bits",
                        .type = kWhole,
                        .default_text = "16",
                        .unit = "bit",
                        .meaning = "Storage of the field: 8, as published, or 16."}}},
      .force = {"[force]",
                "The method by which the force comes from the voxels, docs/concepts/methods.md. A script, "
                "the command line "
                "and a key can change it later.",
                {{.name = "method",
                  .type = kChoice,
                  .default_text = "\"proxy\"",
                  .choices = method_names(),
                  .meaning =
                      "The proxy is held out by every structure's own surface. Of the others the first two "
                      "read the field; the spheres read the labels themselves as they are, the last a "
                      "magnitude and a normal kept with every voxel."},
                 {.name = "sphere_sigma",
                  .type = kNumber,
                  .default_text = "1",
                  .unit = "voxels",
                  .min = GaussianSphere::kMinSigmaVoxels,
                  .max = GaussianSphere::kMaxSigmaVoxels,
                  .meaning = "Of the Gaussian sphere. The smooth sphere has the preparation's sigma."},
                 {.name = "normals",
                  .type = kChoice,
                  .default_text = "\"bytes\"",
                  .choices = {"bytes", "octahedral16", "octahedral24"},
                  .meaning = "How stored normals are kept: a byte for each component as published, or folded "
                             "onto an octahedron in 16 or 24 bits."},
                 {.name = "coupling_damping",
                  .type = kNumber,
                  .default_text = "0",
                  .unit = "N·s/mm",
                  .min = 0,
                  .max = 0.02,
                  .meaning =
                      "Of the proxy: a damper beside the spring between it and the tip. It lets a hand hold "
                      "stiffer walls."}}},
      .yielding =
          {"[yielding]",
           "Whether soft tissue gives way. By layers nothing moves, and each structure holds the tool out by "
           "its `stiffness`. An elastic body dents, spreads sideways, and is harder over what is hard below. "
           "Its `youngs_modulus` says how hard; `stiffness` does for what does not yield "
           "([tissue.md](../concepts/tissue.md)).",
           {{.name = "law",
             .type = kChoice,
             .default_text = "\"layers\"",
             .choices = names_of(kTissueLaws),
             .meaning =
                 "`elastic`: tissues with a `youngs_modulus` yield. `neo-hookean`: likewise, and stiffen "
                 "where they are squeezed far; beside the servo a frame takes twice the processor time. Both "
                 "by the proxy alone. `chainmail`: they are felt as by layers, and seen to move as in the "
                 "chain mail of Gibson 1997."},
            {.name = "cell",
             .type = kNumber,
             .unit = "mm",
             .min = 0.2,
             .max = 10,
             .meaning = "Of all laws but `layers`: edge of the cubes that they are computed on. Without it: "
                        "twice the voxels' least spacing, at least 0.8 and at most 3."},
            {.name = "relaxation",
             .type = kFlag,
             .default_text = "false",
             .meaning =
                 "Of both elastic laws. `true`: tissues without a `relaxation` of their own have that of "
                 "their preset. With `false` they have none."}}},
      .tool =
          {"[tool]",
           "A rigid set of spheres, and of capsules (below), that touch; the first one's usual place is the "
           "origin, the tip. The proxy feels them whole, the other methods feel the spheres' centres.",
           {{.name = "name", .type = kText, .default_text = "\"point\"", .meaning = "Shown in the report."},
            {.name = "points",
             .type = kPoints,
             .default_text = "[[0, 0, 0]]",
             .unit = "mm",
             .min = -100,
             .max = 100,
             .meaning = "1 to 4 points [x, y, z] in the tip's frame."},
            {.name = "radius",
             .type = kNumber,
             .default_text = "0",
             .unit = "mm",
             .min = 0,
             .max = kWidestTool_mm,
             .meaning = "Of the sphere at every point; felt by the proxy."},
            {.name = "capsule",
             .type = kTables,
             .meaning = "What is long: a shaft, a hook. With the points at most 4.",
             .under = "tool."},
            {.name = "kind",
             .type = kChoice,
             .default_text = "\"probe\"",
             .choices = {"probe", "burr", "shaver"},
             .meaning =
                 "A burr takes away what it touches while its motor runs, a shaver what of that is soft "
                 "([burr.md](../guide/burr.md#a-shaver)). They have no `points`, `radius` and `capsule`, and "
                 "are felt "
                 "by the proxy "
                 "alone."},
            {.name = "shape",
             .type = kChoice,
             .default_text = "\"ball\"",
             .choices = {"ball", "cylinder", "cone"},
             .meaning = "Of a burr's head. Cylinders and cones have round ends: voxels hold no sharp edge. "
                        "The middle of the ball at the tip is where the device's tip is, and the head goes "
                        "on from there along `spindle`."},
            {.name = "diameter",
             .type = kNumber,
             .default_text = "4",
             .unit = "mm",
             .min = 1,
             .max = 6,
             .meaning = "Of a burr, of a cone at its far end; at least two voxels. A shaver has 5.5 by "
                        "default."},
            {.name = "length",
             .type = kNumber,
             .unit = "mm",
             .min = 1,
             .max = 20,
             .meaning = "Of a cylinder or cone, the whole head; longer than it is wide."},
            {.name = "tip_diameter",
             .type = kNumber,
             .unit = "mm",
             .min = 0.5,
             .max = 6,
             .meaning = "Of a cone at its tip, where it may be the wider end; at least two voxels."},
            {.name = "speed",
             .type = kNumber,
             .default_text = "60000",
             .unit = "1/min",
             .min = 100,
             .max = 200000,
             .meaning = "Of a burr: revolutions while its motor runs. A shaver has 2500 by default."},
            {.name = "spindle",
             .type = kPoint,
             .default_text = "[0, 0, 1]",
             .min = -1,
             .max = 1,
             .meaning = "Of a burr: direction of its axis in the tip's frame, from the tip to the handle. "
                        "What lies on it cuts little."},
            {.name = "grip",
             .type = kNumber,
             .default_text = "0.5",
             .min = 0.05,
             .max = 2,
             .meaning = "Of a burr: force along the cutting edges over the force that presses."},
            {.name = "pedal",
             .type = kWhole,
             .min = 0,
             .max = 31,
             .meaning = "Of a burr: the device's button that runs its motor while it is held. Without it the "
                        "page, the keys and the script do."}}},
      .capsule = {"[[tool.capsule]]",
                  "A cylinder with round ends, fixed to the tool; the proxy alone feels it.",
                  {{.name = "from",
                    .type = kPoint,
                    .unit = "mm",
                    .min = -300,
                    .max = 300,
                    .meaning = "One end of its axis, in the tip's frame. Has to be there."},
                   {.name = "to",
                    .type = kPoint,
                    .unit = "mm",
                    .min = -300,
                    .max = 300,
                    .meaning = "The other end, at least 0.1 mm away. Has to be there."},
                   {.name = "radius",
                    .type = kNumber,
                    .unit = "mm",
                    .min = 0,
                    .max = kWidestTool_mm,
                    .meaning = "Without it: the tool's `radius`."}}},
      .workspace =
          {"[workspace]",
           "How the device's reach lies in the patient. What a hand feels of a tissue is `scale` · "
           "`force_gain` "
           "times its stiffness. The middle of the reach lies at `home`, in the workspace's coordinates: +x "
           "right, +y forward, +z up, from the volume's centre.",
           {{.name = "scale",
             .type = kNumber,
             .default_text = "1",
             .min = kMinScale,
             .max = kMaxScale,
             .meaning = "Millimetres in the patient for each one of the device: above 1 the reach is wider, "
                        "below 1 the hand is finer."},
            {.name = "force_gain",
             .type = kNumber,
             .default_text = "1",
             .min = kMinScale,
             .max = kMaxScale,
             .meaning = "Newtons at the device for each one in the patient. Limits hold for the device's."},
            {.name = "yaw",
             .type = kNumber,
             .default_text = "0",
             .unit = "degrees",
             .min = -180,
             .max = 180,
             .meaning = "Turn of the device about the up axis, anticlockwise from above: where the person "
                        "sits."},
            {.name = "home",
             .type = kPoint,
             .default_text = "[0, 0, 0]",
             .unit = "mm",
             .min = -1000,
             .max = 1000,
             .meaning = "Where the middle of the device's reach lies. Without it: the volume's centre."},
            {.name = "clutch_button",
             .type = kWhole,
             .min = 0,
             .max = 31,
             .meaning = "The button that, while held, lets the hand move and the tip rest. Without it there "
                        "is no clutch."}}},
      .limits =
          {"[limits]",
           "Besides what the device itself can give, and what `--max-force` says.",
           {{.name = "max_force",
             .type = kNumber,
             .unit = "N",
             .min = 0.1,
             .max = 40,
             .meaning = "The force is never larger. It can only lower the limit that device and user set: "
                        "without `--max-force` the lesser of the device's continuous rating (1.4 N for "
                        "`premium-1.5`) and 3 N."}}},
      .distances =
          {"[distances]",
           "Of what the distances from the tool are told in every tick: from its outline to each structure's "
           "own surface, negative inside. Each takes memory as a felt structure does.",
           {{.name = "structures",
             .type = kChoice,
             .default_text = "\"none\"",
             .choices = {"none", "felt", "all"},
             .meaning = "`felt`: of what is felt. `all`: of every structure of the label map. Those of a "
                        "[[no_go]] are told in any case."},
            {.name = "reach",
             .type = kNumber,
             .default_text = "20",
             .unit = "mm",
             .min = 1,
             .max = 50,
             .meaning = "What is farther away is not told."}}},
      .no_go = {
          "[[no_go]]",
          "A region that pushes the tool out, felt or not: structures, all that lies behind a plane, or a "
          "ball. Places are of the patient, LPS.",
          {{.name = "name", .type = kText, .meaning = "Shown where the tool is pushed. Has to be there."},
           {.name = "structures",
            .type = kLabels,
            .min = 1,
            .max = 65535,
            .meaning = "Each is a region: by name exactly as the names have them, or by number. They need "
                       "not belong to a tissue."},
           {.name = "point",
            .type = kPoint,
            .unit = "mm",
            .min = -1e6,
            .max = 1e6,
            .meaning = "Of a plane: a place on it."},
           {.name = "outward",
            .type = kDirection,
            .min = -1e6,
            .max = 1e6,
            .choices = {"superior", "inferior", "anterior", "posterior", "left", "right"},
            .meaning = "Of a plane: towards where the tool may be."},
           {.name = "centre", .type = kPoint, .unit = "mm", .min = -1e6, .max = 1e6, .meaning = "Of a ball."},
           {.name = "radius",
            .type = kNumber,
            .unit = "mm",
            .min = kNoGoRadius_mm.min,
            .max = kNoGoRadius_mm.max,
            .meaning = "Of a ball."},
           {.name = "keep_away",
            .type = kNumber,
            .default_text = "1",
            .unit = "mm",
            .min = 0,
            .max = kMaxKeepAway_mm,
            .meaning = "So far before the region the force begins, from the tool's outline."},
           {.name = "stiffness",
            .type = kNumber,
            .default_text = "2",
            .unit = "N/mm",
            .min = kNoGoStiffness_N_per_mm.min,
            .max = kNoGoStiffness_N_per_mm.max,
            .meaning = "Force for each mm that the tool is nearer; no more than a hand holds with the "
                       "device, as of a tissue."}}}};
}

SceneKeys with_second_tool(SceneKeys keys) {
  keys.second_tool = keys.tool;
  keys.second_tool.heading = "[second_tool]";
  for (KeySpec& key : keys.second_tool.keys)
    if (key.type == kTables) key.under = "second_tool.";
  keys.second_capsule = keys.capsule;
  keys.second_capsule.heading = "[[second_tool.capsule]]";
  return keys;
}

}  // namespace

const SceneKeys& scene_key_tables() {
  static const SceneKeys keys = with_second_tool(declared_keys());
  return keys;
}

const ScriptKeys& script_key_tables() {
  constexpr std::string_view kStructure =
      "The structure, by name exactly as the labels have it, or `\"#95\"` by number: a place on it that a "
      "hand can reach is found from the labels. Or a point, LPS: the felt structure whose surface is "
      "nearest, "
      "at most 5 mm away.";
  static const std::vector<std::string_view> kDirections{"superior",  "inferior", "anterior",
                                                         "posterior", "left",     "right"};
  static const ScriptKeys keys{
      .top = {"top level",
              "The hand and the device that are simulated.",
              {{.name = "title", .type = kText, .meaning = "Shown in the report."},
               {.name = "device",
                .type = kText,
                .default_text = "\"premium-1.5\"",
                .meaning = "`\"premium-1.5\"` or `\"touch\"`."},
               {.name = "hand",
                .type = kText,
                .default_text = "\"firm-grip\"",
                .meaning = "`\"light-grip\"`, `\"firm-grip\"` or `\"whole-arm\"`."},
               {.name = "rate",
                .type = kNumber,
                .default_text = "1000",
                .unit = "Hz",
                .min = 250,
                .max = 10000,
                .meaning = "Force updates a second."},
               {.name = "delay",
                .type = kNumber,
                .default_text = "0",
                .unit = "ms",
                .min = 0,
                .max = 20,
                .meaning = "From a command to its force, as a bus or a driver adds it."},
               {.name = "tremor",
                .type = kNumber,
                .default_text = "0.03",
                .unit = "mm",
                .min = 0,
                .max = 1,
                .meaning = "Amplitude of the hand's tremor at 8 to 12 Hz."},
               {.name = "seed",
                .type = kWhole,
                .default_text = "1",
                .min = 0,
                .max = 9007199254740991.0,
                .meaning = "Of the tremor: the same seed, the same run."},
               {.name = "step", .type = kTables, .meaning = "1 to 1000 of them, done in order."}}},
      .actions = {
          {"approach",
           "Moves to a free place in front of a structure, then touches it. Whatever was touched before has "
           "to be left first.",
           {{.name = "approach",
             .type = kPlace,
             .unit = "mm",
             .min = -1e6,
             .max = 1e6,
             .meaning = kStructure},
            {.name = "landmark",
             .type = kChoice,
             .choices = kDirections,
             .meaning = "Touches the structure's most superior, most inferior, ... place, or one within 5 mm "
                        "of being it."},
            {.name = "nearest",
             .type = kPlace,
             .unit = "mm",
             .min = -1e6,
             .max = 1e6,
             .meaning = "Touches the structure where it is nearest to another one, or to a point, LPS; or "
                        "within 5 mm of that. Not beside `landmark`."},
            {.name = "from",
             .type = kDirection,
             .min = -1e6,
             .max = 1e6,
             .choices = kDirections,
             .meaning = "Whence the hand comes on its last, straight stretch; or in LPS. Without it the way "
                        "is found, along the surface's normal where that is free."},
            {.name = "speed",
             .type = kNumber,
             .default_text = "40",
             .unit = "mm/s",
             .min = 0.1,
             .max = 200,
             .meaning = "Of the way there; less near what is felt, and the touch itself is slower."},
            {.name = "clearance",
             .type = kNumber,
             .default_text = "15",
             .unit = "mm",
             .min = 1,
             .max = 100,
             .meaning = "The last stretch to the surface is straight and at most this long."}}},
          {"press",
           "Pushes along the surface's normal until the force is reached. Needs an approach before.",
           {{.name = "press",
             .type = kNumber,
             .unit = "N",
             .min = 0.02,
             .max = 40,
             .meaning = "The force. Limits hold all the same: what they do not allow is not reached."},
            {.name = "settle",
             .type = kNumber,
             .default_text = "0.5",
             .unit = "s",
             .min = 0,
             .max = 10,
             .meaning = "For how long the force has to stay within 10 % before the next step."}}},
          {"hold",
           "Keeps the force until it has been held so long: within 20 % of what was pressed, on the "
           "structure "
           "approached, without a break. Needs an approach before.",
           {{.name = "hold", .type = kNumber, .unit = "s", .min = 0.01, .max = 60, .meaning = "How long."}}},
          {"slide",
           "Moves along the surface, keeping the force. Needs an approach before.",
           {{.name = "slide", .type = kNumber, .unit = "mm", .min = 0.1, .max = 200, .meaning = "How far."},
            {.name = "direction",
             .type = kDirection,
             .default_text = "\"superior\"",
             .min = -1e6,
             .max = 1e6,
             .choices = kDirections,
             .meaning = "The patient's; or in LPS: +x to the patient's left, +y posterior, +z superior. What "
                        "points out of "
                        "the surface is taken away; the length does not matter."},
            {.name = "speed",
             .type = kNumber,
             .default_text = "10",
             .unit = "mm/s",
             .min = 0.1,
             .max = 200,
             .meaning = "Along the surface; at most what lets the hand stop within a third of a millimetre "
                        "of what it meets."}}},
          {"rotate",
           "Turns the object while the hand stays, commanded ten times a second. A hand that touches yields "
           "with the surface; one that does not steps back first.",
           {{.name = "rotate",
             .type = kNumber,
             .unit = "degrees",
             .min = -180,
             .max = 180,
             .meaning = "By how much, right-handed about the axis."},
            {.name = "axis",
             .type = kDirection,
             .default_text = "\"up\"",
             .min = -1e6,
             .max = 1e6,
             .choices = {"right", "forward", "up"},
             .meaning = "The workspace's; or in its coordinates: +x right, +y forward, +z up."},
            {.name = "seconds",
             .type = kNumber,
             .default_text = "1",
             .unit = "s",
             .min = 0.1,
             .max = 60,
             .meaning = "How long it takes."}}},
          {"method",
           "Feels by another force method from here on; within a tenth of a second the force of the last one "
           "turns into the new one's.",
           {{.name = "method",
             .type = kChoice,
             .choices = method_names(),
             .meaning = "One of docs/concepts/methods.md."}}},
          {"leave",
           "Withdraws along the way of the approach. Needs an approach before.",
           {{.name = "leave", .type = kFlag, .meaning = "`true`."},
            {.name = "speed",
             .type = kNumber,
             .default_text = "60",
             .unit = "mm/s",
             .min = 0.1,
             .max = 200,
             .meaning = "Of the withdrawal."}}},
          {"motor",
           "Switches the motor of the tools that cut on or off, wherever the hand is.",
           {{.name = "motor", .type = kFlag, .meaning = "`true`: on."}}},
          {"stroke",
           "Undoes the last stroke of a tool that cuts, or does the last one again that was undone, wherever "
           "the hand is. A stroke is what was cut from the motor's start to its stop. The motor must be off, "
           "or the step fails.",
           {{.name = "stroke",
             .type = kChoice,
             .choices = {"undo", "redo"},
             .meaning =
                 "`undo`: takes back the last stroke. `redo`: does again the one that was undone last."}}},
          {"law",
           "Lets soft tissue go by another law from here on, wherever the hand is. Between `elastic` and "
           "`neo-hookean`, and between `layers` and `chainmail`, that is at once. From one of these pairs to "
           "the other surfaces are made anew, for which the hand waits, and then until stiffer tissue has "
           "pushed it out as far as it presses. With a tool that cuts a scene cannot change between the "
           "pairs, and tissue that does not move at the start cannot begin to.",
           {{.name = "law",
             .type = kChoice,
             .choices = names_of(kTissueLaws),
             .meaning = "As `law` of the scene's `[yielding]` (docs/concepts/tissue.md)."}}},
          {"scope",
           "Lets the scope of a second hand look at something from here on, wherever the first hand is: its "
           "camera goes straight there, through whatever is there, turns, and then goes and turns with it. A "
           "script with such a step has two devices, of which the second is led and feels nothing; `palpate "
           "simulate` alone has that hand.",
           {{.name = "scope",
             .type = kPlace,
             .unit = "mm",
             .min = -1e6,
             .max = 1e6,
             .meaning = "What is in the middle of its picture: `\"probe\"`, the first device's tip; or a "
                        "point, LPS."},
            {.name = "from",
             .type = kDirection,
             .default_text = "\"anterior\"",
             .min = -1e6,
             .max = 1e6,
             .choices = kDirections,
             .meaning = "On which side of that the camera is; or in LPS."},
            {.name = "distance",
             .type = kNumber,
             .default_text = "20",
             .unit = "mm",
             .min = 1,
             .max = 200,
             .meaning = "From that to the camera."},
            {.name = "speed",
             .type = kNumber,
             .default_text = "40",
             .unit = "mm/s",
             .min = 0.1,
             .max = 200,
             .meaning = "Of the camera."},
            {.name = "optics",
             .type = kNumber,
             .default_text = "30",
             .unit = "degrees",
             .max = 90,
             .meaning =
                 "Between the scope's shaft, which leans superior, and where it looks. As the task has "
                 "it (docs/guide/tasks.md)."},
            {.name = "back",
             .type = kNumber,
             .default_text = "8",
             .unit = "mm",
             .max = 30,
             .meaning = "From the scope's tip back along its shaft to the camera. Likewise."}}}}};
  return keys;
}

std::vector<std::string_view> direction_names() {
  std::vector<std::string_view> names;
  for (const auto& [name, direction] : kPatientDirections) names.push_back(name);
  return names;
}

KeySpec structures_key(std::string_view meaning) {
  return {.name = "structures", .type = KeyType::kLabels, .min = 1, .max = 65535, .meaning = meaning};
}

std::string number_text(double value) {
  // plain decimal notation for numbers of ordinary size
  const double size = std::abs(value);
  const bool plain = size == 0 || (size >= 1e-6 && size < 1e16);
  std::array<char, 64> digits{};
  const auto format = plain ? std::chars_format::fixed : std::chars_format::general;
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value, format).ptr;
  return {digits.data(), end};
}

std::string range_text(const KeySpec& key) {
  if (!key.choices.empty()) {
    std::string text;
    for (std::size_t i = 0; i < key.choices.size(); ++i) {
      const bool last = i + 1 == key.choices.size();
      text += concat({i == 0 ? "" : last ? " or " : ", ", "\"", key.choices[i], "\""});
    }
    return key.type == kDirection ? text + ", or [x, y, z]" : text;
  }
  if (!key.has_range()) return "";
  return concat({number_text(key.min), " ... ", number_text(key.max), key.unit.empty() ? "" : " ", key.unit});
}

std::string_view type_text(KeyType type) {
  switch (type) {
    case kText:
      return "a text";
    case kFile:
      return "a path";
    case kChoice:
      return "a choice";
    case kFlag:
      return "true or false";
    case kNumber:
      return "a number";
    case kWhole:
      return "a whole number";
    case kColour:
      return "a colour";
    case kLabels:
      return "a list of label names and numbers";
    case kNames:
      return "a list of names";
    case kInterval:
      return "two numbers";
    case kPoint:
      return "a point [x, y, z]";
    case kPlace:
      return "a text or a point [x, y, z]";
    case kPoints:
      return "a list of points";
    case kTerms:
      return "a list of pairs [part, time]";
    case kDirection:
      return "a direction";
    case kTable:
      return "a table";
    case kTables:
      return "tables";
  }
  return "";
}

std::string remedy_text(const KeySpec& key) {
  std::string text = std::string(key.name) + " takes ";
  const std::string range = range_text(key);
  if (key.type == KeyType::kChoice || key.type == KeyType::kDirection) {
    text += range;
  } else {
    text += std::string(type_text(key.type)) + (range.empty() ? "" : ", " + range);
  }
  if (key.type == KeyType::kTable) text = "write [" + std::string(key.name) + "] on a line of its own";
  if (key.type == KeyType::kTables)
    text = "write [[" + std::string(key.under) + std::string(key.name) + "]] on a line of its own";
  return key.default_text.empty() ? text : text + "; default " + std::string(key.default_text);
}

std::optional<Fault> range_error(const KeySpec& key, double value) {
  const std::string name(key.name);
  if (!std::isfinite(value)) return Fault{name + " is not a finite number", remedy_text(key)};
  if (key.has_range() && (value < key.min || value > key.max))
    return Fault{name + " = " + number_text(value) + " is outside " + range_text(key), remedy_text(key)};
  return std::nullopt;
}

std::string_view nearest(std::string_view text, const std::vector<std::string_view>& candidates) {
  // a mistyped name is short; this bounds the cost of comparing longer texts
  constexpr std::size_t kMaxCompared = 100;
  text = text.substr(0, kMaxCompared);
  std::string_view best;
  int least = std::max(1, static_cast<int>(text.size()) / 3) + 1;
  for (const auto candidate : candidates) {
    // the difference in length is a lower bound of the distance
    const auto length = static_cast<int>(std::min(candidate.size(), kMaxCompared));
    if (std::abs(length - static_cast<int>(text.size())) >= least) continue;
    const int edits = edit_distance(text, candidate.substr(0, kMaxCompared));
    if (edits >= least) continue;
    best = candidate;
    least = edits;
  }
  return best;
}

std::string did_you_mean(std::string_view text, const std::vector<std::string_view>& candidates,
                         std::string_view quote) {
  const std::string_view candidate = nearest(text, candidates);
  return candidate.empty() ? "" : concat({"did you mean ", quote, candidate, quote, "? "});
}

std::string scene_keys() {
  const SceneKeys& keys = scene_key_tables();
  std::string text = table_markdown(keys.top);
  for (const TableSpec* table :
       {&keys.data, &keys.tissue, &keys.preparation, &keys.force, &keys.yielding, &keys.tool, &keys.capsule,
        &keys.workspace, &keys.limits, &keys.distances, &keys.no_go})
    text += concat({"\n", table_markdown(*table)});
  return text;
}

std::string script_keys() {
  const ScriptKeys& keys = script_key_tables();
  std::string text = table_markdown(keys.top);
  for (const TableSpec& action : keys.actions) text += concat({"\n", table_markdown(action)});
  return text;
}

}  // namespace palpate
