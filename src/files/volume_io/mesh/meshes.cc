#include "volume_io/mesh/meshes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>

#include "palpate/base/file.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/label_names.h"
#include "volume_io/labels/label_text.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/labels/masks.h"
#include "volume_io/mesh/mesh_labels.h"
#include "volume_io/mesh/mesh_placement.h"
#include "volume_io/volume_reader.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

// ---- finding files ------------------------------------------------------------------------------

struct FoundMeshes {
  StructureFiles found;
  std::map<fs::path, MeshFormat> formats;
};

FoundMeshes find_meshes(const fs::path& named) {
  FoundMeshes meshes;
  meshes.found = find_structure_files(
      named,
      [&](const fs::path& file) {
        const auto format = mesh_format_of(file);
        if (format) meshes.formats.emplace(file, *format);
        return format.has_value();
      },
      "surface");
  return meshes;
}

// ---- in the reader process ----------------------------------------------------------------------

Result<MeshFile> parse_file(const fs::path& file, MeshFormat format) {
  const auto bytes = palpate::read_file(file, kMaxMeshBytes);
  if (!bytes) return bytes.error();
  return parse_mesh(*bytes, format, file.string());
}

// Anatomical words of the mesh's own name if the file contains several meshes, otherwise those of the file
// name, numbered.
StructureName name_of_mesh(const TriangleMesh& mesh, std::size_t n, std::size_t meshes, const fs::path& file,
                           bool only_file, const std::vector<std::string>& others) {
  // read_labels() names a single structure by its file
  if (meshes == 1 && only_file) return {"", false};
  if (meshes == 1) return name_of_structure(file, others);
  // the mesh's own name is as unreliable as a file name
  const AnatomyInName own = anatomy_in(mesh.name);
  if (!own.name.empty() && !name_fault(own.name)) return {unique_name(own.name, others), own.left_out};
  const AnatomyInName words = name_of_mask(file);
  const std::string name = words.name.empty() ? "structure " + std::to_string(others.size() + 1)
                                              : words.name + " " + std::to_string(n + 1);
  return {unique_name(name, others), own.left_out || words.left_out};
}

std::string as_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

// grid aligned with the patient's axes, limited in memory and time, with a margin
GridGeometry grid_around(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  constexpr double kVoxels = 8e6, kMaxAlong = 2000, kMargin = 4;
  const Eigen::Vector3d extent = high - low;
  const double longest = std::max(extent.maxCoeff(), 1e-3);
  // a flat mesh is treated as if its thickness were a hundredth of its length
  const Eigen::Vector3d thick = extent.cwiseMax(longest / 100);
  GridGeometry grid;
  const double spacing_mm = std::max(std::cbrt(thick.prod() / kVoxels), longest / kMaxAlong);
  grid.spacing_mm = Eigen::Vector3d::Constant(spacing_mm);
  for (int a = 0; a < 3; ++a)
    grid.dims[static_cast<std::size_t>(a)] =
        static_cast<int>(std::ceil(extent[a] / spacing_mm + 2 * kMargin)) + 1;
  const Eigen::Vector3d span =
      spacing_mm * Eigen::Vector3d(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
  grid.origin = Point<Patient>(Eigen::Vector3d(0.5 * (low + high) - 0.5 * span));
  return grid;
}

// maximum number of meshes in all files: each is compared with those that it overlaps
constexpr std::size_t kMaxMeshes = 1024;

using ShouldContinue = std::function<bool()>;  // called regularly; false: the parent has gone

// survey of all files
struct SurveyedMeshes {
  MeshSurvey survey;
  std::optional<MeshSpace> declared;                          // coordinate system that the files state
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = low;  // bounding box, in that system
};

// surveys the points of all files, and the coordinate systems that the files state
Result<SurveyedMeshes> survey_meshes(const FoundMeshes& found_meshes, const fs::path& named,
                                     const GridGeometry* scan, const MeshPlacementOptions& options,
                                     const ShouldContinue& should_continue) {
  SurveyedMeshes all{MeshSurvey(scan, options.unit_mm), {}};
  bool first = true, alike = true;
  std::size_t meshes = 0;
  for (const fs::path& one : found_meshes.found.files) {
    if (!should_continue()) return bad_input("", "reading was interrupted");
    const auto file = parse_file(one, found_meshes.formats.at(one));
    if (!file) return file.error();
    alike = alike && (first || all.declared == file->space);
    all.declared = file->space;
    for (const TriangleMesh& mesh : file->meshes) {
      all.survey.observe(mesh);
      for (const Eigen::Vector3d& point : mesh.points) {
        all.low = first ? point : Eigen::Vector3d(all.low.cwiseMin(point));
        all.high = first ? point : Eigen::Vector3d(all.high.cwiseMax(point));
        first = false;
      }
    }
    meshes += file->meshes.size();
  }
  if (meshes > kMaxMeshes)
    return bad_input(named.string(),
                     "has " + std::to_string(meshes) + " structures, but at most " +
                         std::to_string(kMaxMeshes) + " can be read",
                     "give fewer of them");
  if (!alike && !options.space)
    return bad_input(named.string(),
                     "holds surfaces with different axes: some LPS, others RAS or unspecified",
                     "export all of them with the same axes, or choose the axes of all with --mesh-space");
  return all;
}

// the scan's grid, or one around the meshes
GridGeometry mesh_grid(const GridGeometry* scan, const SurveyedMeshes& all,
                       const TransformedMeshes& placement) {
  if (scan) return *scan;
  const Eigen::Vector3d a = in_patient(all.low, placement.space, placement.unit_mm),
                        b = in_patient(all.high, placement.space, placement.unit_mm);
  return grid_around(a.cwiseMin(b), a.cwiseMax(b));
}

// names of meshes that the user should know about, by reason
struct MeshFindings {
  std::vector<std::string> open, cut, empty, named_in_part;
};

// transforms a mesh into the patient frame; returns whether it extends beyond the grid
bool place_mesh(const TransformedMeshes& placement, const GridGeometry& grid, TriangleMesh& mesh) {
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  bool beyond = false;
  for (Eigen::Vector3d& point : mesh.points) {
    point = in_patient(point, placement.space, placement.unit_mm);
    const Eigen::Vector3d voxel = (X_VoxelPatient * Point<Patient>(point)).eigen();
    for (int a = 0; a < 3; ++a)
      beyond = beyond || voxel[a] < -1 || voxel[a] > grid.dims[static_cast<std::size_t>(a)];
  }
  return beyond;
}

// voxelises all meshes, one by one, and appends their voxels and names to `labels`
Result<void> voxelise_meshes(const FoundMeshes& found_meshes, const fs::path& named, const GridGeometry& grid,
                             const TransformedMeshes& placement, const ShouldContinue& should_continue,
                             double& fraction, StructureLabels& labels, MeshFindings& findings) {
  const std::vector<fs::path>& files = found_meshes.found.files;
  const double fraction_per_file = 1 / static_cast<double>(files.size());
  for (const fs::path& one : files) {
    fraction = fraction_per_file * static_cast<double>(&one - files.data());
    auto file = parse_file(one, found_meshes.formats.at(one));
    if (!file) return file.error();
    for (std::size_t n = 0; n < file->meshes.size(); ++n) {
      if (!should_continue()) return bad_input("", "reading was interrupted");
      TriangleMesh& mesh = file->meshes[n];
      const bool beyond = place_mesh(placement, grid, mesh);
      const auto [name, left_out] =
          name_of_mesh(mesh, n, file->meshes.size(), one, files.size() == 1 && one == named, labels.names);
      if (left_out) findings.named_in_part.push_back(name);
      const std::string shown_name = name.empty() ? "its only structure" : name;
      const ClosedMesh closed = closed_mesh(mesh);
      mesh = {};
      if (!should_continue()) return bad_input("", "reading was interrupted");
      labels.voxels.push_back(voxels_of_mesh(closed, grid, should_continue));
      labels.names.push_back(name);
      if (closed.open_edges > 0)
        findings.open.push_back(shown_name + " along " + std::to_string(closed.open_edges) + " edges");
      if (labels.voxels.back().count() == 0)
        findings.empty.push_back(shown_name);
      else if (beyond)
        findings.cut.push_back(shown_name);
    }
  }
  return {};
}

// @param own_grid  null if the meshes use the scan's grid
void add_mesh_notes(const MeshFindings& findings, const TransformedMeshes& placement,
                    const GridGeometry* own_grid, std::vector<std::string>& notes) {
  notes.push_back(placement.note);
  if (own_grid)
    notes.push_back("is voxelised on its own grid of " + as_text(own_grid->spacing_mm[0]) +
                    " mm; given after a scan, it uses the grid of the scan");
  const auto warn_about = [&](const std::string& what, const std::vector<std::string>& names) {
    if (!names.empty()) notes.push_back(what + ": " + names_in_words(names));
  };
  warn_about(
      "is not closed everywhere: a voxel counts as inside if most directions hit the surface from within",
      findings.open);
  warn_about("extends beyond the scan and is cut off there", findings.cut);
  warn_about("has surfaces that contain no voxel centre", findings.empty);
  if (!findings.named_in_part.empty()) notes.push_back(note_of_left_out(findings.named_in_part));
}

Result<StructureLabels> inspect_meshes(const FoundMeshes& found_meshes, const fs::path& named,
                                       const GridGeometry* scan,
                                       const MeshPlacementOptions& placement_options,
                                       const ShouldContinue& should_continue, double& fraction) {
  const auto all = survey_meshes(found_meshes, named, scan, placement_options, should_continue);
  if (!all) return all.error();
  const auto placed = transform_meshes(all->survey, placement_options, all->declared);
  if (!placed) return Error{ErrorKind::kBadInput, placed.error().what, named.string(), placed.error().remedy};
  const GridGeometry grid = mesh_grid(scan, *all, *placed);
  StructureLabels labels;
  MeshFindings findings;
  if (auto done =
          voxelise_meshes(found_meshes, named, grid, *placed, should_continue, fraction, labels, findings);
      !done)
    return done.error();
  if (auto done = assign_to_layers(labels, grid, named, should_continue); !done) return done.error();
  labels.file.header.has_geometry = placed->space_is_known;
  auto& notes = labels.file.notes;
  notes.insert(notes.end(), found_meshes.found.notes.begin(), found_meshes.found.notes.end());
  add_mesh_notes(findings, *placed, scan ? nullptr : &grid, notes);
  return labels;
}

}  // namespace

std::optional<MeshFormat> mesh_format_of(const fs::path& file) {
  std::error_code failed;
  if (!fs::is_regular_file(file, failed)) return std::nullopt;
  // the extension of a volume takes precedence
  if (format_of(file)) return std::nullopt;
  const auto kind = file_kind_of(file, unpacked_front);
  return kind ? kind->mesh : std::nullopt;
}

bool is_meshes(const fs::path& file) {
  std::error_code failed;
  if (!fs::is_directory(file, failed)) return mesh_format_of(file).has_value();
  // tested by names only, before any file is opened
  if (!volumes_in(file).empty()) return false;
  return !find_meshes(file).found.files.empty() && !is_dicom(file);
}

Result<LabelReader> open_meshes(const fs::path& file, const GridGeometry* scan,
                                const MeshPlacementOptions& placement_options, const Progress& progress) {
  const FoundMeshes meshes = find_meshes(file);
  auto reader = open_structure_files(
      meshes.found, file, progress,
      [&](const std::function<bool()>& should_continue, double& fraction) {
        return inspect_meshes(meshes, file, scan, placement_options, should_continue, fraction);
      },
      "simplify it first, for example with 3D Slicer's Surface Toolbox (Decimate), or give fewer surfaces");
  if (reader && scan && !reader->volume.header.geometry.same_grid(*scan))
    return impossible_volume({&file, 1});
  return reader;
}

}  // namespace palpate::volume_io
