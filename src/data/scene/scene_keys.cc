#include <algorithm>
#include <array>

#include "palpate/contact/tissue_values.h"
#include "palpate/device/settings.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/scene.h"
#include "palpate/surfaces/ramps.h"
#include "scene/keys.h"

namespace palpate {
namespace {

using enum KeyType;

// Adds the keys of all contact properties behind `touchable`. Their defaults are those of ContactProperties.
TableSpec with_contact_keys(TableSpec tissue) {
  static const auto kDefaults = [] {
    std::array<std::string, kContactProperties.size()> texts;
    for (std::size_t n = 0; n < texts.size(); ++n)
      texts[n] = number_text(ContactProperties{}.*kContactProperties[n].value);
    return texts;
  }();
  const auto position_of_key = std::ranges::find(tissue.keys, "touchable", &KeySpec::name);
  std::vector<KeySpec> keys;
  for (std::size_t n = 0; n < kContactProperties.size(); ++n) {
    const ContactProperty& property = kContactProperties[n];
    // static friction follows the scene's friction
    const bool has_default = property.value != &ContactProperties::static_friction;
    keys.push_back({.name = property.key,
                    .type = kNumber,
                    .default_text = has_default ? kDefaults[n] : std::string_view(),
                    .unit = property.unit,
                    .min = property.range.min,
                    .max = property.range.max,
                    .meaning = property.about});
  }
  tissue.keys.insert(std::next(position_of_key), keys.begin(), keys.end());
  return tissue;
}

TableSpec top_table() {
  return {
      "top level",
      "Title of the scene, and its tables.",
      {{.name = "title", .type = kText, .meaning = "Shown in the report; must not identify a patient."},
       {.name = "side",
        .type = kChoice,
        .default_text = "\"unknown\"",
        .choices = names_of(kSides),
        .meaning =
            "Side of the body, shown in the report; `\"both\"` for a head or a torso. Default: the side "
            "of a leg follows from its fibula ([scene.md](../guide/scene.md#which-side))."},
       {.name = "modality",
        .type = kChoice,
        .default_text = "\"unknown\"",
        .choices = names_of(kModalities),
        .meaning = "Modality of the scan. The viewer shows the values of a CT in HU, with suitable windows. "
                   "Default: a scan with values of -500 and below is a CT, any other is unknown."},
       {.name = "data", .type = kTable, .meaning = "The files. Required."},
       {.name = "tissue", .type = kTables, .meaning = "A tissue and its contact properties: 1 to 64 tables."},
       {.name = "preparation", .type = kTable, .meaning = "Preparation of the field from the labels."},
       {.name = "force", .type = kTable, .meaning = "Method of computing the force."},
       {.name = "yielding", .type = kTable, .meaning = "Deformation of soft tissue under the tool."},
       {.name = "density",
        .type = kTable,
        .meaning = "Cutting energy of bone by its density in a calibrated CT."},
       {.name = "tool", .type = kTable, .meaning = "The tool of every device."},
       {.name = "second_tool",
        .type = kTable,
        .meaning = "Tool of the second device: a table with the keys and defaults of `[tool]`. Default: "
                   "the same tool as the other devices."},
       {.name = "workspace", .type = kTable, .meaning = "Mapping of the device's workspace to the patient."},
       {.name = "limits", .type = kTable, .meaning = "Limit of the force."},
       {.name = "distances", .type = kTable, .meaning = "Structures whose distance to the tool is reported."},
       {.name = "no_go", .type = kTables, .meaning = "Regions that push the tool out."}}};
}

TableSpec data_table() {
  return {
      "[data]",
      "The files, relative to the scene file's folder or absolute. At least one of `scan` and `labels`.",
      {{.name = "scan",
        .type = kFile,
        .meaning = "The image: NRRD, NIfTI or MetaImage, a DICOM file or folder, or an image stack."},
       {.name = "scan_volume",
        .type = kInteger,
        .min = 1,
        .max = 100000,
        .meaning = "Number of the volume in DICOM with several volumes, as listed by `palpate info`. "
                   "Default: the only usable one."},
       {.name = "labels",
        .type = kFile,
        .meaning = "Its segmentation, in the same formats or `.seg.nrrd`; or surfaces (STL, OBJ, PLY, "
                   "VTK polydata), as one file or a folder with one file per structure; or a folder "
                   "with one mask per structure."},
       {.name = "mesh_space",
        .type = kChoice,
        .choices = names_of(kSurfaceAxes),
        .meaning = "Axes of surfaces. Default: as stated in their file, otherwise inferred from the scan."},
       {.name = "mesh_unit",
        .type = kChoice,
        .choices = names_of(kSurfaceUnits),
        .meaning = "Unit of the coordinates of surfaces. Default: inferred from the scan, otherwise mm."},
       {.name = "image_spacing",
        .type = kPoint,
        .unit = "mm",
        .min = 1e-4,
        .max = 100,
        .meaning = "Spacing between the columns, rows and slices of an image stack (PNG, TIFF, JPEG), "
                   "which does not store it."},
       {.name = "nifti_form",
        .type = kChoice,
        .choices = names_of(kHeaderForms),
        .meaning =
            "Transform to use for a NIfTI file that has both a qform and an sform. Default: the sform."},
       {.name = "cropped_scan",
        .type = kFlag,
        .default_text = "false",
        .meaning = "`true`: the scan covers only part of the labelled region, so that more than half of "
                   "the labels may lie outside it."},
       {.name = "names",
        .type = kFile,
        .meaning =
            "Names and colours of the labels: Slicer's `.ctbl`, `.tsv`, `.csv`, `.json`, ITK-SNAP's "
            "`.label`. Default: the names in the label file, otherwise those of a table next to it."}}};
}

TableSpec tissue_table() {
  return with_contact_keys(
      {"[[tissue]]",
       "A group of structures that feel alike, defined by one of `labels`, `threshold` and `embedding`. "
       "A preset gives initial values, which other keys override; the defaults below apply without a "
       "preset. A tissue may not be stiffer than one that it rests on, nor rest on one that is not "
       "touchable: "
       "the force at their border would point inward.",
       {{.name = "name", .type = kText, .meaning = "Unique in the scene; `rests_on` refers to it. Required."},
        {.name = "preset",
         .type = kChoice,
         .choices = {"bone", "cartilage", "meniscus", "disc", "ligament", "muscle", "fat", "skin", "vessel",
                     "nerve", "liver", "kidney", "spleen", "lung", "heart", "brain", "gland", "lymph node",
                     "tumour"},
         .meaning = "Initial values ([presets.md](presets.md))."},
        {.name = "labels",
         .type = kLabels,
         .min = 1,
         .max = 65535,
         .meaning = "The structures, by exact name or by number. A name selects every structure with "
                    "that name; no structure belongs to two tissues."},
        {.name = "optional",
         .type = kFlag,
         .default_text = "false",
         .meaning = "`true`: labels missing from the map are ignored instead of being an error."},
        {.name = "threshold",
         .type = kInterval,
         .unit = "the scan's unit",
         .min = -1e9,
         .max = 1e9,
         .meaning = "`[low, high]` on the raw scan, without labels: the structure is every voxel at or "
                    "above their mean. For the union Gaussian the weight is 0 at or below `low`, 1 at or "
                    "above `high`, and linear between."},
        {.name = "embedding",
         .type = kFlag,
         .default_text = "false",
         .meaning = "`true`: the tissue consists of the unlabelled voxels inside the body, so that "
                    "organs are embedded in it. The body is the labelled region, the part of the scan "
                    "connected to it above `air_below`, and everything enclosed by them in space or in "
                    "an axial slice. At most one tissue."},
        {.name = "air_below",
         .type = kNumber,
         .unit = "the scan's unit",
         .min = -1e9,
         .max = 1e9,
         .meaning = "For an embedding: scan value that separates air from the body. Default: only voxels "
                    "enclosed by labels are inside."},
        {.name = "touchable",
         .type = kFlag,
         .default_text = "true",
         .meaning = "`false`: displayed only, without contact."},
        {.name = "puncture",
         .type = kNumber,
         .unit = "N",
         .min = 0.05,
         .max = 40,
         .meaning = "For the proxy: force at which the tool punctures the surface. Default: never."},
        {.name = "after_puncture",
         .type = kChoice,
         .default_text = "\"closes\"",
         .choices = {"closes", "stays_open"},
         .meaning = "For a tissue with `puncture`. `closes`: the tissue closes behind the tool, and the "
                    "next puncture needs the force again. `stays_open`: a tool that is not wider passes "
                    "there without force."},
        {.name = "cutting_energy",
         .type = kNumber,
         .default_text = "100",
         .unit = "mJ/mm³",
         .min = 1,
         .max = 10000,
         .meaning = "For a burr: work of its motor to remove a cubic millimetre. For a shaver the "
                    "default for tissue with a modulus is 5."},
        {.name = "protection",
         .type = kChoice,
         .default_text = "\"none\"",
         .choices = {"none", "alarm", "keep"},
         .meaning = "Protection from a burr. `alarm`: cutting it raises an alarm. `keep`: the burr "
                    "cannot enter it."},
        {.name = "youngs_modulus",
         .type = kNumber,
         .unit = "kPa",
         .min = kElasticModulusRange.min_kPa,
         .max = kElasticModulusRange.max_kPa,
         .meaning = "Young's modulus for `[yielding] law = \"elastic\"`, `\"neo-hookean\"` and "
                    "`\"exponential\"`, without effect under another law. A tissue without a modulus, "
                    "its own or its preset's, does "
                    "not yield, such as bone."},
        {.name = "poissons_ratio",
         .type = kNumber,
         .default_text = "0.45",
         .min = 0,
         .max = kMaxPoissonsRatio,
         .meaning = "Poisson's ratio for the same laws: lateral expansion under compression; near 0.5 "
                    "the volume is preserved. Requires a modulus, the tissue's own or the preset's."},
        {.name = "stiffening",
         .type = kNumber,
         .default_text = "0",
         .min = 0,
         .max = kMaxStiffening,
         .meaning = "For `law = \"exponential\"`: exponent b of Fung's law, by which stress grows with "
                    "exp(b (I1 - 3)), I1 - 3 being about three times the squared strain. 0: as "
                    "`\"neo-hookean\"`. Requires a modulus, the tissue's own or the preset's."},
        {.name = "relaxation",
         .type = kTerms,
         .unit = "s",
         .min = kRelaxationTimeRange.min_s,
         .max = kRelaxationTimeRange.max_s,
         .meaning = "Stress relaxation for the same laws: one or two pairs of the fraction of the "
                    "modulus that relaxes, with a sum below 1, and the time constant. The modulus is "
                    "then the instantaneous one. Default, and with `[]`: no relaxation, but see "
                    "`[yielding] relaxation`. Requires a modulus."},
        {.name = "friction_damping",
         .type = kNumber,
         .default_text = "0.005",
         .unit = "N·s/mm",
         .min = 0,
         .max = 0.1,
         .meaning = "For the direct methods: tangential force per mm/s, below its two limits "
                    "(`friction`, `friction_max`)."},
        {.name = "friction_max",
         .type = kNumber,
         .default_text = "0.5",
         .unit = "N",
         .min = 0,
         .max = 10,
         .meaning = "For the direct methods: absolute limit of the tangential force."},
        {.name = "colour",
         .type = kColour,
         .meaning = "`\"#rrggbb\"`. Default: that of the preset; without one those of the "
                    "structures."},
        {.name = "opacity",
         .type = kNumber,
         .default_text = "1",
         .min = 0,
         .max = 1,
         .meaning = "In pictures: 0 invisible, 1 solid."},
        {.name = "rests_on",
         .type = kNames,
         .default_text = "[]",
         .meaning = "Tissues of this scene that support this one. They must be touchable and at least as "
                    "stiff."}}});
}

TableSpec preparation_table() {
  return {"[preparation]",
          "Field of the direct methods: ramps that begin at the surface of every structure, or, "
          "as published, the labels weighted by stiffness and smoothed together.",
          {{.name = "method",
            .type = kChoice,
            .default_text = "\"inward-ramp\"",
            .choices = {"inward-ramp", "union-gaussian"},
            .meaning = "The ramp is 0 outside the voxels of every structure and rises with the "
                       "depth inside. The Gaussian enlarges structures and fills narrow gaps."},
           {.name = "ramp_width",
            .type = kNumber,
            .default_text = "4",
            .unit = "mm",
            .min = kMinRampWidth_mm,
            .max = kMaxRampWidth_mm,
            .meaning = "For the inward ramp: depth at which the stiffest tissue reaches its full "
                       "force, `stiffness` times this. At least twice the largest voxel spacing, "
                       "which is the default if it is larger."},
           {.name = "sigma",
            .type = kNumber,
            .default_text = "1",
            .unit = "mm",
            .min = 0,
            .max = 10,
            .meaning = "Width of the union Gaussian, the same on every axis, and of the smooth "
                       "sphere. A wider one is softer and quieter and loses thin structures."},
           {.name = "engine",
            .type = kChoice,
            .default_text = "\"direct\"",
            .choices = {"direct", "fourier"},
            .meaning = "For the union Gaussian: separable convolution, or the filter in the "
                       "frequency domain as published."},
           {.name = "bits",
            .type = kInteger,
            .default_text = "16",
            .unit = "bit",
            .meaning = "Bits per voxel of the field: 8, as published, or 16."}}};
}

TableSpec force_table() {
  return {"[force]",
          "Method of computing the force from the voxels, docs/concepts/methods.md. A script, the "
          "command line and a key can change it later.",
          {{.name = "method",
            .type = kChoice,
            .default_text = "\"proxy\"",
            .choices = names_of(kForceMethods),
            .meaning = "The proxy is constrained by the surface of every structure. Of the others, the "
                       "first two sample the field; the spheres sample the labels themselves; the last "
                       "samples a magnitude and a normal stored with every voxel."},
           {.name = "sphere_sigma",
            .type = kNumber,
            .default_text = "1",
            .unit = "voxels",
            .min = GaussianSphere::kMinSigmaVoxels,
            .max = GaussianSphere::kMaxSigmaVoxels,
            .meaning = "Width of the Gaussian sphere. The smooth sphere uses the sigma of the preparation."},
           {.name = "normals",
            .type = kChoice,
            .default_text = "\"bytes\"",
            .choices = {"bytes", "octahedral16", "octahedral24"},
            .meaning = "Encoding of stored normals: one byte per component as published, or octahedral "
                       "in 16 or 24 bits."},
           {.name = "coupling_damping",
            .type = kNumber,
            .default_text = "0",
            .unit = "N·s/mm",
            .min = 0,
            .max = 0.02,
            .meaning = "For the proxy: damper parallel to the spring between proxy and tip. It allows "
                       "higher stiffness to be rendered stably."}}};
}

TableSpec deformation_table() {
  return {"[yielding]",
          "Deformation of soft tissue. With layers nothing moves, and each structure pushes the "
          "tool out with its `stiffness`. An elastic body dents, spreads sideways, and is harder "
          "above hard structures. It uses `youngs_modulus`; tissue that does not yield uses "
          "`stiffness` ([tissue.md](../concepts/tissue.md)).",
          {{.name = "law",
            .type = kChoice,
            .default_text = "\"layers\"",
            .choices = names_of(kTissueLaws),
            .meaning = "`elastic`: tissues with a `youngs_modulus` yield. `neo-hookean`: the same, "
                       "but they stiffen under large strain; solving a frame takes twice the "
                       "processor time. `exponential`: the same, and tissues with a `stiffening` "
                       "stiffen by it. All three require the proxy. `chainmail`: contact as with "
                       "layers, with a displayed deformation by the chain mail of Gibson 1997."},
           {.name = "cell",
            .type = kNumber,
            .unit = "mm",
            .min = 0.2,
            .max = 10,
            .meaning = "For all laws but `layers`: edge of the cubic cells of the solver. Default: "
                       "the smallest voxel spacing, at least 0.8 and at most 3; up to twice as much "
                       "for a tool with a radius of more than 10 voxels."},
           {.name = "relaxation",
            .type = kFlag,
            .default_text = "false",
            .meaning = "For the three elastic laws. `true`: tissues without a `relaxation` of their own "
                       "use that of their preset. `false`: they do not relax."}}};
}

TableSpec density_table() {
  return {"[density]",
          "For a burr. In a calibrated CT every voxel of touchable tissue without a modulus, such as "
          "bone, has the `cutting_energy` of its tissue times the square of HU / `full`. This ratio is "
          "limited to 0.1 to 1.25 ([burr.md](../guide/burr.md#density)).",
          {{.name = "calibrated",
            .type = kFlag,
            .default_text = "false",
            .meaning = "`true`: the scan is a CT in calibrated Hounsfield units, and energies follow it. A "
                       "cone-beam CT is not calibrated. `false`: energies depend on the tissue alone."},
           {.name = "full",
            .type = kNumber,
            .default_text = "1700",
            .unit = "HU",
            .min = 200,
            .max = 4000,
            .meaning = "Attenuation of bone that takes the whole `cutting_energy`. The default is that of "
                       "cortical bone of 1.9 g/cm³."}}};
}

TableSpec tool_table() {
  return {
      "[tool]",
      "A rigid set of spheres, and of capsules (below), that make contact; the first one is usually at "
      "the origin, the tip. The proxy uses their full shape, the other methods the centres of the "
      "spheres.",
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
        .max = kMaxToolRadius_mm,
        .meaning = "Radius of the sphere at every point; used by the proxy."},
       {.name = "capsule",
        .type = kTables,
        .meaning = "Elongated parts, such as a shaft or a hook. At most 4 points and capsules together.",
        .heading_prefix = "tool."},
       {.name = "kind",
        .type = kChoice,
        .default_text = "\"probe\"",
        .choices = {"probe", "burr", "shaver"},
        .meaning = "A burr removes the tissue that it touches while its motor runs, a shaver only soft "
                   "tissue ([burr.md](../guide/burr.md#a-shaver)). They have no `points`, `radius` and "
                   "`capsule`, and require the proxy."},
       {.name = "shape",
        .type = kChoice,
        .default_text = "\"ball\"",
        .choices = {"ball", "cylinder", "cone"},
        .meaning = "Shape of a burr's head. Cylinders and cones have round ends, because voxels cannot "
                   "represent a sharp edge. The centre of the ball at the tip is at the device's tip, "
                   "and the head extends from there along `spindle`."},
       {.name = "diameter",
        .type = kNumber,
        .default_text = "4",
        .unit = "mm",
        .min = 1,
        .max = 6,
        .meaning = "Diameter of a burr, or of a cone at its far end; at least two voxels. Default for a "
                   "shaver: 5.5."},
       {.name = "length",
        .type = kNumber,
        .unit = "mm",
        .min = 1,
        .max = 20,
        .meaning = "Length of the whole head of a cylinder or cone; greater than its width."},
       {.name = "tip_diameter",
        .type = kNumber,
        .unit = "mm",
        .min = 0.5,
        .max = 6,
        .meaning = "Diameter of a cone at its tip, which may be the wider end; at least two voxels."},
       {.name = "speed",
        .type = kNumber,
        .default_text = "60000",
        .unit = "1/min",
        .min = 100,
        .max = 200000,
        .meaning = "For a burr: speed of rotation while its motor runs. Default for a shaver: 2500."},
       {.name = "spindle",
        .type = kPoint,
        .default_text = "[0, 0, 1]",
        .min = -1,
        .max = 1,
        .meaning = "For a burr: direction of its axis in the tip's frame, from the tip to the handle. "
                   "Parts of the head near the axis cut little."},
       {.name = "grip",
        .type = kNumber,
        .default_text = "0.5",
        .min = 0.05,
        .max = 2,
        .meaning = "For a burr: ratio of the force along the cutting edges to the normal force."},
       {.name = "flutes",
        .type = kInteger,
        .default_text = "8",
        .min = 1,
        .max = 100,
        .meaning = "For a burr: number of its cutting edges, which determines the vibration. Default for a "
                   "shaver: 2."},
       {.name = "irrigation",
        .type = kFlag,
        .default_text = "true",
        .meaning = "For a burr: whether it is cooled. Otherwise the temperature rise of the bone is "
                   "estimated and recorded."},
       {.name = "pedal",
        .type = kInteger,
        .min = 0,
        .max = 31,
        .meaning = "For a burr: device button that runs its motor while pressed. Default: the page, the "
                   "keys and the script switch the motor."}}};
}

TableSpec capsule_table() {
  return {"[[tool.capsule]]",
          "A cylinder with round ends, fixed to the tool; used by the proxy only.",
          {{.name = "from",
            .type = kPoint,
            .unit = "mm",
            .min = -300,
            .max = 300,
            .meaning = "One end of its axis, in the tip's frame. Required."},
           {.name = "to",
            .type = kPoint,
            .unit = "mm",
            .min = -300,
            .max = 300,
            .meaning = "The other end, at least 0.1 mm away. Required."},
           {.name = "radius",
            .type = kNumber,
            .unit = "mm",
            .min = 0,
            .max = kMaxToolRadius_mm,
            .meaning = "Default: the tool's `radius`."}}};
}

TableSpec workspace_table() {
  return {"[workspace]",
          "Mapping of the device's workspace to the patient. The stiffness at the hand is `scale` · "
          "`force_gain` times that of the tissue. The centre of the workspace lies at `home`, in its own "
          "coordinates: +x right, +y forward, +z up, from the volume's centre.",
          {{.name = "scale",
            .type = kNumber,
            .default_text = "1",
            .min = kMinScale,
            .max = kMaxScale,
            .meaning = "Millimetres in the patient per millimetre of the device: above 1 the reach is "
                       "wider, below 1 motion is finer."},
           {.name = "force_gain",
            .type = kNumber,
            .default_text = "1",
            .min = kMinScale,
            .max = kMaxScale,
            .meaning =
                "Newtons at the device per newton in the patient. Limits apply to the force at the device."},
           {.name = "yaw",
            .type = kNumber,
            .default_text = "0",
            .unit = "degrees",
            .min = -180,
            .max = 180,
            .meaning = "Rotation of the device about the up axis, anticlockwise from above, by the position "
                       "of the operator."},
           {.name = "home",
            .type = kPoint,
            .default_text = "[0, 0, 0]",
            .unit = "mm",
            .min = -1000,
            .max = 1000,
            .meaning = "Position of the centre of the device's workspace. Default: the volume's centre."},
           {.name = "clutch_button",
            .type = kInteger,
            .min = 0,
            .max = 31,
            .meaning = "Button of the clutch: while it is pressed, the hand moves and the tip stays. "
                       "Default: no clutch."}}};
}

TableSpec limits_table() {
  return {
      "[limits]",
      "In addition to the limits of the device and of `--max-force`.",
      {{.name = "max_force",
        .type = kNumber,
        .unit = "N",
        .min = kMaxForceRange.min,
        .max = kMaxForceRange.max,
        .meaning = "Maximum force. It can only lower the limit set by device and user: without `--max-force` "
                   "the lesser of the device's continuous rating (1.4 N for `premium-1.5`) and 3 N."}}};
}

TableSpec distances_table() {
  return {"[distances]",
          "Structures whose distance to the tool is reported in every tick: from the outline of the tool to "
          "the surface of the structure, negative inside. Each needs as much memory as a touchable "
          "structure.",
          {{.name = "structures",
            .type = kChoice,
            .default_text = "\"none\"",
            .choices = {"none", "touchable", "all"},
            .meaning = "`touchable`: structures whose tissue is touchable. `all`: every structure of the "
                       "label map. Those of "
                       "a [[no_go]] are always reported."},
           {.name = "reach",
            .type = kNumber,
            .default_text = "20",
            .unit = "mm",
            .min = 1,
            .max = 50,
            .meaning = "Maximum distance reported."}}};
}

TableSpec no_go_table() {
  return {
      "[[no_go]]",
      "A region that pushes the tool out, touchable or not: structures, the half-space behind a plane, "
      "or a "
      "ball. Patient coordinates, LPS.",
      {{.name = "name", .type = kText, .meaning = "Shown while the tool is pushed out. Required."},
       {.name = "structures",
        .type = kLabels,
        .min = 1,
        .max = 65535,
        .meaning = "Structures of the region, by exact name or by number. They need not belong to a tissue."},
       {.name = "point",
        .type = kPoint,
        .unit = "mm",
        .min = -1e6,
        .max = 1e6,
        .meaning = "For a plane: a point on it."},
       {.name = "outward",
        .type = kDirection,
        .min = -1e6,
        .max = 1e6,
        .choices = direction_names(),
        .meaning = "For a plane: direction towards the permitted side."},
       {.name = "centre",
        .type = kPoint,
        .unit = "mm",
        .min = -1e6,
        .max = 1e6,
        .meaning = "For a ball: its centre."},
       {.name = "radius",
        .type = kNumber,
        .unit = "mm",
        .min = kNoGoRadius_mm.min,
        .max = kNoGoRadius_mm.max,
        .meaning = "For a ball: its radius."},
       {.name = "keep_away",
        .type = kNumber,
        .default_text = "1",
        .unit = "mm",
        .min = 0,
        .max = kMaxKeepAway_mm,
        .meaning =
            "Distance from the region at which the force begins, measured from the outline of the tool."},
       {.name = "stiffness",
        .type = kNumber,
        .default_text = "2",
        .unit = "N/mm",
        .min = kNoGoStiffness_N_per_mm.min,
        .max = kNoGoStiffness_N_per_mm.max,
        .meaning = "Force per mm below that distance; limited, as for a tissue, to the stiffness that "
                   "can be rendered stably with the device."}}};
}

SceneKeys with_second_tool(SceneKeys keys) {
  keys.second_tool = keys.tool;
  keys.second_tool.heading = "[second_tool]";
  for (KeySpec& key : keys.second_tool.keys)
    if (key.type == kTables) key.heading_prefix = "second_tool.";
  keys.second_capsule = keys.capsule;
  keys.second_capsule.heading = "[[second_tool.capsule]]";
  return keys;
}

}  // namespace

const SceneKeys& scene_key_tables() {
  static const SceneKeys keys = with_second_tool({.top = top_table(),
                                                  .data = data_table(),
                                                  .tissue = tissue_table(),
                                                  .preparation = preparation_table(),
                                                  .force = force_table(),
                                                  .deformation = deformation_table(),
                                                  .density = density_table(),
                                                  .tool = tool_table(),
                                                  .capsule = capsule_table(),
                                                  .workspace = workspace_table(),
                                                  .limits = limits_table(),
                                                  .distances = distances_table(),
                                                  .no_go = no_go_table()});
  return keys;
}

std::string scene_keys() {
  const SceneKeys& keys = scene_key_tables();
  std::string text = table_markdown(keys.top);
  for (const TableSpec* table :
       {&keys.data, &keys.tissue, &keys.preparation, &keys.force, &keys.deformation, &keys.density,
        &keys.tool, &keys.capsule, &keys.workspace, &keys.limits, &keys.distances, &keys.no_go})
    text += "\n" + table_markdown(*table);
  return text;
}

}  // namespace palpate
