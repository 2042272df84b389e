#include "palpate/contact/tissue_values.h"
#include "palpate/device/session_settings.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/scene.h"
#include "palpate/surfaces/ramps.h"
#include "scene/scene_tables.h"

namespace palpate {
namespace {

using enum KeyType;

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
