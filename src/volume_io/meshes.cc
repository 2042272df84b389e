#include "volume_io/meshes.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <new>

#include "palpate/base/file.h"
#include "palpate/base/reading.h"
#include "volume_io/formats.h"
#include "volume_io/label_names.h"
#include "volume_io/label_text.h"
#include "volume_io/layered_labels.h"
#include "volume_io/mesh_labels.h"
#include "volume_io/mesh_placing.h"
#include "volume_io/volume_message.h"
#include "volume_io/volume_reader.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

// ---- which files there are ----------------------------------------------------------------------

struct NamedMesh {
  fs::path file;
  MeshFormat format{};
};

struct FoundMeshes {
  std::vector<NamedMesh> files;  // in the order of their names
  std::vector<fs::path> roots;   // that the process may open, and what stands below them
  std::vector<std::string> notes;
  bool volumes = false;  // among them
};

FoundMeshes find_meshes(const fs::path& named) {
  FoundMeshes found;
  found.roots.push_back(named);
  std::error_code failed;
  if (!fs::is_directory(named, failed)) {
    if (const auto format = mesh_format_of(named)) found.files.push_back({named, *format});
    return found;
  }
  constexpr std::size_t kMostFiles = 4096, kMostRoots = 32;
  std::size_t looked_at = 0, others = 0, led_out = 0;
  fs::directory_iterator entry(named, failed);
  for (; !failed && entry != fs::directory_iterator() && looked_at < kMostFiles; entry.increment(failed)) {
    std::error_code ignored;
    if (!entry->is_regular_file(ignored)) continue;
    ++looked_at;
    found.volumes = found.volumes || format_of(entry->path());
    const auto format = mesh_format_of(entry->path());
    if (!format) {
      ++others;
    } else if (entry->is_symlink(ignored) && !check_stays_in(named, entry->path())) {
      ++led_out;
    } else {
      if (entry->is_symlink(ignored) && found.roots.size() < kMostRoots)
        found.roots.push_back(fs::canonical(entry->path(), ignored).parent_path());
      found.files.push_back({entry->path(), *format});
    }
  }
  if (!failed && entry != fs::directory_iterator())
    found.notes.push_back("holds more than " + std::to_string(kMostFiles) +
                          " files, of which no more were looked at");
  std::ranges::sort(found.files, {}, &NamedMesh::file);
  if (led_out > 0)
    found.notes.push_back(std::to_string(led_out) + (led_out == 1 ? " link leads" : " links lead") +
                          " out of the folder and was not followed (--follow-links allows it)");
  if (others > 0)
    found.notes.push_back(std::to_string(others) +
                          (others == 1 ? " other file in it is" : " other files in it are") +
                          " no surface, and passed over");
  return found;
}

// ---- in the process that reads ------------------------------------------------------------------

Result<MeshFile> parse_file(const NamedMesh& named) {
  const auto bytes = palpate::read_file(named.file, kMostMeshBytes);
  if (!bytes) return bytes.error();
  return parse_mesh(*bytes, named.format, named.file.string());
}

// the words of anatomy in its own name where a file holds several, else those in its file's, numbered
struct MeshName {
  std::string name;
  bool left_out = false;  // of a name something
};
MeshName name_of_mesh(const TriangleMesh& mesh, std::size_t n, std::size_t meshes, const fs::path& file,
                      bool only_file, const std::vector<std::string>& others) {
  // read_labels() calls a single structure after its file
  if (meshes == 1 && only_file) return {"", false};
  const auto alone = [&](std::string name) {
    if (std::ranges::find(others, name) != others.end())
      name += " (" + std::to_string(others.size() + 1) + ")";
    return name;
  };
  // whoever saved the file wrote this name as well
  const AnatomyInName own = meshes > 1 ? anatomy_in(mesh.name) : AnatomyInName();
  if (!own.name.empty() && !name_fault(own.name)) return {alone(own.name), own.left_out};
  const AnatomyInName words = name_of_mask(file);
  const bool left_out = own.left_out || words.left_out;
  if (words.name.empty()) return {alone("structure " + std::to_string(others.size() + 1)), left_out};
  return {alone(meshes == 1 ? words.name : words.name + " " + std::to_string(n + 1)), left_out};
}

std::string as_text(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.3g", value);
  return text;
}

// axes along the patient's, as many voxels as memory and time bear, and a margin around
GridGeometry grid_around(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
  constexpr double kVoxels = 8e6, kMostAlong = 2000, kMargin = 4;
  const Eigen::Vector3d extent = high - low;
  const double longest = std::max(extent.maxCoeff(), 1e-3);
  // of a flat one as if it were a hundredth as thick
  const Eigen::Vector3d thick = extent.cwiseMax(longest / 100);
  GridGeometry grid;
  const double spacing_mm = std::max(std::cbrt(thick.prod() / kVoxels), longest / kMostAlong);
  grid.spacing_mm = Eigen::Vector3d::Constant(spacing_mm);
  for (int a = 0; a < 3; ++a)
    grid.dims[static_cast<std::size_t>(a)] =
        static_cast<int>(std::ceil(extent[a] / spacing_mm + 2 * kMargin)) + 1;
  const Eigen::Vector3d span =
      spacing_mm * Eigen::Vector3d(grid.dims[0] - 1, grid.dims[1] - 1, grid.dims[2] - 1);
  grid.origin = Point<Patient>(Eigen::Vector3d(0.5 * (low + high) - 0.5 * span));
  return grid;
}

// of all files together: each is compared with those that it meets
constexpr std::size_t kMostMeshes = 1024;

struct MeshLabels {
  std::vector<std::string> names;
  std::vector<MeshVoxels> voxels;
  std::vector<int> layers;
  VolumeFile file;
};

// Signs of life, some a second however often they are asked for.
template <class Sign>
std::function<bool()> now_and_then(const Sign& sign) {
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kBetween(100);
  return [sign, next = Clock::now(), heard = true]() mutable {
    if (const auto now = Clock::now(); heard && now >= next) {
      next = now + kBetween;
      heard = sign();
    }
    return heard;
  };
}

// @param look  called now and then; false: nobody listens any more
Result<MeshLabels> look_at_meshes(const FoundMeshes& found, const fs::path& named, const GridGeometry* scan,
                                  const MeshPlacing& asked, const std::function<bool()>& look) {
  // what their points say of how they lie; of files that say their axes each for itself
  MeshSurvey survey(scan, asked.unit_mm);
  std::optional<MeshSpace> stated;
  bool first = true, alike = true;
  std::size_t meshes = 0;
  Eigen::Vector3d low = Eigen::Vector3d::Zero(), high = low;
  for (const NamedMesh& one : found.files) {
    if (!look()) return bad_input("", "nobody reads it");
    const auto file = parse_file(one);
    if (!file) return file.error();
    alike = alike && (first || stated == file->space);
    stated = file->space;
    for (const TriangleMesh& mesh : file->meshes) {
      survey.see(mesh);
      for (const Eigen::Vector3d& point : mesh.points) {
        low = first ? point : Eigen::Vector3d(low.cwiseMin(point));
        high = first ? point : Eigen::Vector3d(high.cwiseMax(point));
        first = false;
      }
    }
    meshes += file->meshes.size();
  }
  if (meshes > kMostMeshes)
    return bad_input(named.string(),
                     "has " + std::to_string(meshes) + " structures, and " + std::to_string(kMostMeshes) +
                         " are read at most",
                     "take some of them");
  if (!alike && !asked.space)
    return bad_input(named.string(),
                     "holds surfaces that do not say the same of their axes: some LPS, others RAS or nothing",
                     "export all of them alike, or say with --mesh-space how all are to be read");
  const auto placed = place_meshes(survey, asked, stated);
  if (!placed) return Error{ErrorKind::kBadInput, placed.error().what, named.string(), placed.error().remedy};

  MeshLabels labels;
  GridGeometry grid;
  if (scan) {
    grid = *scan;
  } else {
    const Eigen::Vector3d a = in_patient(low, placed->space, placed->unit_mm),
                          b = in_patient(high, placed->space, placed->unit_mm);
    grid = grid_around(a.cwiseMin(b), a.cwiseMax(b));
  }
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  std::vector<std::string> open, cut, empty, named_in_part;
  for (const NamedMesh& one : found.files) {
    auto file = parse_file(one);
    if (!file) return file.error();
    for (std::size_t n = 0; n < file->meshes.size(); ++n) {
      if (!look()) return bad_input("", "nobody reads it");
      TriangleMesh& mesh = file->meshes[n];
      bool beyond = false;
      for (Eigen::Vector3d& point : mesh.points) {
        point = in_patient(point, placed->space, placed->unit_mm);
        const Eigen::Vector3d voxel = (X_VoxelPatient * Point<Patient>(point)).eigen();
        for (int a = 0; a < 3; ++a)
          beyond = beyond || voxel[a] < -1 || voxel[a] > grid.dims[static_cast<std::size_t>(a)];
      }
      const auto [name, left_out] = name_of_mesh(mesh, n, file->meshes.size(), one.file,
                                                 found.files.size() == 1 && one.file == named, labels.names);
      if (left_out) named_in_part.push_back(name);
      const std::string said = name.empty() ? "its only structure" : name;
      const ClosedMesh closed = closed_mesh(mesh);
      mesh = {};
      if (!look()) return bad_input("", "nobody reads it");
      labels.voxels.push_back(MeshVoxels::make(closed, grid, look));
      labels.names.push_back(name);
      if (closed.open_edges > 0)
        open.push_back(said + " along " + std::to_string(closed.open_edges) + " edges");
      if (labels.voxels.back().count() == 0)
        empty.push_back(said);
      else if (beyond)
        cut.push_back(said);
    }
  }

  const auto read_slice = [&](std::size_t k, const auto& take) -> Result<void> {
    for (std::size_t n = 0; n < labels.voxels.size(); ++n)
      labels.voxels[n].read_slice(static_cast<int>(k), [&](std::size_t v) { take(v, static_cast<int>(n)); });
    return {};
  };
  const auto meetings = find_meetings(grid, read_slice, look);
  if (!meetings) return meetings.error();
  labels.file = labels_in_slices(grid, named);
  labels.file.header.has_geometry = placed->space_is_known;
  labels.layers = put_in_layers(labels.voxels.size(), *meetings, labels.file);
  for (std::size_t n = 0; n < labels.names.size(); ++n)
    put_segment(labels.file, n, labels.names[n], static_cast<int>(n + 1), labels.layers[n], "");
  auto& notes = labels.file.notes;
  notes.insert(notes.end(), found.notes.begin(), found.notes.end());
  notes.push_back(placed->note);
  if (!scan)
    notes.push_back("gets a grid of its own, of " + as_text(grid.spacing_mm[0]) +
                    " mm: given after a scan it is laid on that one's");
  const auto tell = [&](const std::string& what, const std::vector<std::string>& names) {
    if (!names.empty()) notes.push_back(what + ": " + names_in_words(names));
  };
  tell(
      "is no closed surface everywhere, and a voxel is in where more than half of all directions meet it "
      "from within",
      open);
  tell("reaches beyond the scan and is cut off there", cut);
  tell("has surfaces of which no voxel's centre is in", empty);
  tell(
      "has words in the names of its files or objects that are not known to be anatomy and might name a "
      "patient; a table gives their structures any name, numbered as they stand in order (--names TABLE). "
      "They are called",
      named_in_part);
  return labels;
}

Result<void> send_meshes(const MeshLabels& labels, VoxelSink& sink) {
  const auto read_slice = [&](int layer, std::size_t k, const auto& take) -> Result<void> {
    for (std::size_t n = 0; n < labels.voxels.size(); ++n)
      if (labels.layers[n] == layer)
        labels.voxels[n].read_slice(static_cast<int>(k),
                                    [&](std::size_t v) { take(v, static_cast<int>(n + 1)); });
    return {};
  };
  return send_layers(labels.file.header, read_slice, sink);
}

}  // namespace

std::optional<MeshFormat> mesh_format_of(const fs::path& file) {
  std::error_code failed;
  if (!fs::is_regular_file(file, failed)) return std::nullopt;
  // a volume's name says what it is
  if (format_of(file)) return std::nullopt;
  const auto kind = content_of(file, unpacked_front);
  return kind ? kind->mesh : std::nullopt;
}

bool is_meshes(const fs::path& file) {
  std::error_code failed;
  if (!fs::is_directory(file, failed)) return mesh_format_of(file).has_value();
  const FoundMeshes found = find_meshes(file);
  return !found.files.empty() && !found.volumes && !is_dicom(file);
}

Result<MeshReader> open_meshes(const fs::path& file, const GridGeometry* scan, const MeshPlacing& placing,
                               const Progress& progress) {
  const FoundMeshes found = find_meshes(file);
  std::vector<int> descriptors;
  for (const fs::path& root : found.roots)
    if (const int descriptor = ::open(root.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); descriptor >= 0)
      descriptors.push_back(descriptor);
  // whose refusals may name any of them
  std::vector<fs::path> names{file};
  for (const NamedMesh& one : found.files) names.push_back(one.file);
  auto process = start_reader(descriptors, kSlots * kSlotBytes, progress, [&](reader::ParentEnd& parent) {
    const auto labels = [&]() -> Result<MeshLabels> {
      try {
        return look_at_meshes(found, file, scan, placing, now_and_then(sign_of_life(parent)));
      } catch (const std::bad_alloc&) {
        return bad_input(
            file.string(), "does not fit into the memory that it is read in",
            "simplify it first, as by 3D Slicer's Surface Toolbox (Decimate), or take some of it");
      }
    }();
    return read_labels_for(parent, file, labels, [&](VoxelSink& sink) { return send_meshes(*labels, sink); });
  });
  for (const int descriptor : descriptors) ::close(descriptor);
  if (!process)
    return Error{process.error().kind, process.error().what, file.string(), process.error().remedy};
  while (true) {
    std::uint32_t word = 0;
    if (auto said = (*process)->read(std::as_writable_bytes(std::span(&word, 1))); !said)
      return about(said.error(), names);
    if (word != kEnd) continue;
    if (auto understood = receive_end(**process, names); !understood) return understood.error();
    break;
  }
  const Files named{&file, 1};
  auto answer = receive_answer(**process, named);
  if (!answer) return answer.error();
  auto* volume = std::get_if<VolumeFile>(&*answer);
  if (!volume || volume->voxels.encoding != Encoding::kSlices ||
      (scan && !volume->header.geometry.same_grid(*scan)))
    return nonsense(named);
  return MeshReader{*std::move(process), std::move(*volume)};
}

}  // namespace palpate::volume_io
