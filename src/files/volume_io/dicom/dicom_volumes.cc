#include "volume_io/dicom/dicom_volumes.h"

#include <algorithm>
#include <map>
#include <utility>

#include "volume_io/dicom/dicom_descriptions.h"
#include "volume_io/dicom/dicom_grouping.h"
#include "volume_io/dicom/dicom_slice_stack.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;
using Frames = std::vector<DicomFrame>;

constexpr std::size_t kListed = 10;

std::string list_of(const std::vector<DicomVolume>& volumes, bool usable_alone) {
  std::string text;
  std::size_t listed = 0, left_out = 0;
  for (std::size_t n = 0; n < volumes.size(); ++n) {
    const DicomVolume& volume = volumes[n];
    if (usable_alone && !volume.fault.empty()) continue;
    if (listed == kListed) {
      ++left_out;
      continue;
    }
    ++listed;
    text += (listed == 1 ? " " : "; ") + std::to_string(n + 1) + ") " + volume.what +
            (volume.fault.empty() ? "" : ": " + volume.fault);
  }
  if (left_out > 0) text += "; and " + std::to_string(left_out) + " more (palpate info lists them)";
  return text;
}

}  // namespace

Vector normal_of(const DicomFrame& frame) {
  return frame.along_row.cross(frame.along_column).normalized();
}

double corner_off_mm(const DicomFrame& a, const DicomFrame& b) {
  const auto off = [](const Vector& u, const Vector& v, int steps) { return (u - v).norm() * steps; };
  return off(a.along_row * a.column_spacing_mm, b.along_row * b.column_spacing_mm, a.columns - 1) +
         off(a.along_column * a.row_spacing_mm, b.along_column * b.row_spacing_mm, a.rows - 1);
}

bool is_lossy(const DicomVolume& volume) {
  return std::ranges::any_of(volume.frames, &DicomFrame::lossy);
}

std::string slice_in_words(const std::vector<DicomFrame>& frames, std::size_t n) {
  return "slice " + std::to_string(n + 1) + " of " + std::to_string(frames.size()) + ", at " +
         in_mm(frames[n].position.dot(normal_of(frames.front()))) + " mm along its normal";
}

std::string slice_in_words(const GridGeometry& grid, std::size_t n) {
  const Vector normal = Vector(grid.direction.col(0)).cross(Vector(grid.direction.col(1))).normalized();
  const Vector position =
      grid.origin.eigen() + static_cast<double>(n) * grid.spacing_mm[2] * Vector(grid.direction.col(2));
  return "slice " + std::to_string(n + 1) + " of " + std::to_string(grid.dims[2]) + ", at " +
         in_mm(position.dot(normal)) + " mm along its normal";
}

std::vector<DicomVolume> sort_into_volumes(std::vector<DicomFrame> frames) {
  std::vector<DicomVolume> volumes;
  std::vector<Frames> parts;
  for (Frames& group : grouped(std::move(frames)))
    for (Frames& part : split_duplicates(std::move(group))) parts.push_back(std::move(part));
  for (Frames& part : parts) {
    DicomVolume& volume = volumes.emplace_back();
    volume.frames = std::move(part);
    const DicomFrame& first = volume.frames.front();
    if (!first.placed) {
      volume.fault = images_in_words(volume.frames.size()) + ": " + first.fault;
      volume.remedy = first.remedy;
      continue;
    }
    const SliceStack stack(volume.frames);
    if (auto fault = stack.find_fault()) {
      volume.fault = std::move(fault->what);
      volume.remedy = std::move(fault->remedy);
      continue;
    }
    volume.geometry = stack.geometry();
    volume.notes = stack.find_notes();
    if (const auto possible = checked(volume.geometry, ""); !possible) {
      volume.fault = possible.error().what;
      volume.remedy = kWholeSeries;
    }
  }

  // descriptions relative to the other volumes of the series
  std::map<int, std::vector<const DicomFrame*>> of_series;
  for (const DicomVolume& volume : volumes)
    if (volume.frames.front().placed)
      of_series[volume.frames.front().series].push_back(&volume.frames.front());
  for (DicomVolume& volume : volumes) {
    volume.what = description_of(volume.frames, volume.geometry);
    if (volume.frames.front().placed)
      volume.what += distinguishing_attributes(volume.frames, of_series[volume.frames.front().series]);
    if (is_lossy(volume)) volume.what += ", compressed with loss";
  }
  return volumes;
}

Result<std::size_t> choose_volume(const std::vector<DicomVolume>& volumes, std::optional<int> number) {
  const auto of = [&](std::size_t n) -> Result<std::size_t> {
    if (volumes[n].fault.empty()) return n;
    const std::string which =
        volumes.size() == 1 ? "" : "volume " + std::to_string(n + 1) + " cannot be used: ";
    return bad_input("", which + volumes[n].fault, volumes[n].remedy);
  };
  if (number) {
    if (*number >= 1 && static_cast<std::size_t>(*number) <= volumes.size())
      return of(static_cast<std::size_t>(*number) - 1);
    return bad_input("", "has no volume " + std::to_string(*number) + " but these:" + list_of(volumes, false),
                     "choose one of them with --volume N");
  }
  std::vector<std::size_t> usable;
  for (std::size_t n = 0; n < volumes.size(); ++n)
    if (volumes[n].fault.empty()) usable.push_back(n);
  if (usable.size() == 1) return usable.front();
  if (volumes.size() == 1) return of(0);
  if (usable.empty())
    return bad_input("", "holds no volume that can be used:" + list_of(volumes, false),
                     volumes.front().remedy);
  return bad_input("", "holds " + std::to_string(usable.size()) + " volumes:" + list_of(volumes, true),
                   "choose one with --volume N; in a scene file: scan_volume = N");
}

}  // namespace palpate::volume_io
