#include "volume_io/dicom/dicom_grouping.h"

#include <algorithm>
#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <utility>

namespace palpate::volume_io {
namespace {

using Vector = Eigen::Vector3d;
using Frames = std::vector<DicomFrame>;

using VolumeKey = std::tuple<int, bool, int, int, std::optional<double>, std::optional<double>, bool,
                             std::optional<double>, std::string, std::string, std::string, std::string>;

// key of attributes that are equal in all images of a volume, except those compared with a tolerance
VolumeKey volume_key(const DicomFrame& frame) {
  // images without a position are distinguished only by what they lack
  if (!frame.placed)
    return {frame.series, true, 0, 0, {}, {}, false, {}, "", frame.modality, "", frame.fault};
  return {frame.series,
          false,
          frame.rows,
          frame.columns,
          frame.echo_time_ms,
          frame.b_value,
          frame.gradient.has_value(),
          frame.temporal_position,
          frame.stack,
          frame.modality,
          frame.image_type,
          ""};
}

// diffusion directions equal except for rounding
bool same_gradient(const DicomFrame& a, const DicomFrame& b) {
  constexpr double kSame = 1e-2;
  return !a.gradient || !b.gradient ||
         (Vector(a.gradient->data()) - Vector(b.gradient->data())).norm() <= kSame;
}

std::vector<Frames> split_by_frame_of_reference(Frames frames) {
  std::map<std::string, Frames> parts;
  const bool one_volume = !frames.front().placed || has_reference_per_position(frames);
  for (DicomFrame& frame : frames)
    parts[one_volume ? std::string() : frame.frame_of_reference].push_back(std::move(frame));
  std::vector<Frames> all;
  for (auto& [reference, part] : parts) all.push_back(std::move(part));
  return all;
}

void sort_by_position(Frames& frames) {
  const Vector normal = normal_of(frames.front());
  std::stable_sort(frames.begin(), frames.end(), [&](const DicomFrame& a, const DicomFrame& b) {
    return a.position.dot(normal) < b.position.dot(normal);
  });
}

// number of sorted frames at each position
std::vector<std::size_t> counts_at_positions(const Frames& frames) {
  const Vector normal = normal_of(frames.front());
  std::vector<std::size_t> counts{1};
  for (std::size_t n = 1; n < frames.size(); ++n) {
    const double gap_mm = (frames[n].position - frames[n - 1].position).dot(normal);
    gap_mm < kSamePosition_mm ? void(++counts.back()) : counts.push_back(1);
  }
  return counts;
}

bool has_doubles(const Frames& frames) {
  return counts_at_positions(frames).size() < frames.size();
}

// Cardiac images are taken at several phases for each position. Trigger times vary with the heart rate from
// position to position, so their order is used.
std::vector<Frames> split_by_trigger_time(const Frames& sorted) {
  const auto counts = counts_at_positions(sorted);
  const std::size_t each = counts.front();
  const auto has_trigger_time = [](const DicomFrame& frame) { return frame.trigger_time_ms.has_value(); };
  if (std::ranges::any_of(counts, [&](std::size_t count) { return count != each; }) ||
      !std::ranges::all_of(sorted, has_trigger_time))
    return {};
  std::vector<Frames> parts(each);
  for (std::size_t first = 0; first < sorted.size(); first += each) {
    Frames here(sorted.begin() + static_cast<std::ptrdiff_t>(first),
                sorted.begin() + static_cast<std::ptrdiff_t>(first + each));
    std::ranges::stable_sort(here, {}, [](const DicomFrame& frame) { return *frame.trigger_time_ms; });
    for (std::size_t n = 0; n < each; ++n) {
      if (n > 0 && here[n].trigger_time_ms == here[n - 1].trigger_time_ms) return {};
      parts[n].push_back(std::move(here[n]));
    }
  }
  return parts;
}

// Returns nothing if every part would be a single slice, as for repeated acquisitions of one position.
std::vector<Frames> split_by_acquisition(const Frames& sorted) {
  std::map<int, Frames> parts;
  for (const DicomFrame& frame : sorted) {
    if (!frame.acquisition) return {};
    parts[*frame.acquisition].push_back(frame);
  }
  if (parts.size() == sorted.size()) return {};
  std::vector<Frames> all;
  for (auto& [number, part] : parts) {
    if (has_doubles(part)) return {};
    all.push_back(std::move(part));
  }
  return all;
}

}  // namespace

bool has_reference_per_position(const Frames& frames) {
  std::map<std::string, const DicomFrame*> first_of_reference;
  for (const DicomFrame& frame : frames) {
    const auto [first, is_new] = first_of_reference.emplace(frame.frame_of_reference, &frame);
    if (!is_new && (frame.position - first->second->position).norm() >= kSamePosition_mm) return false;
  }
  return first_of_reference.size() > 1;
}

std::vector<Frames> grouped(Frames frames) {
  // a group with one key is split by orientation, pixel spacing and diffusion direction
  std::map<VolumeKey, std::vector<Frames>> groups;
  for (DicomFrame& frame : frames) {
    auto& parts = groups[volume_key(frame)];
    const auto fits = [&](const Frames& part) {
      constexpr double kSame_mm = 0.02;
      return !frame.placed ||
             (corner_off_mm(part.front(), frame) <= kSame_mm && same_gradient(part.front(), frame));
    };
    // images of one scan are usually consecutive
    auto part = std::find_if(parts.rbegin(), parts.rend(), fits);
    (part != parts.rend() ? *part : parts.emplace_back()).push_back(std::move(frame));
  }
  std::vector<Frames> all;
  for (auto& [key, parts] : groups)
    for (auto& part : parts)
      for (auto& volume : split_by_frame_of_reference(std::move(part))) all.push_back(std::move(volume));
  return all;
}

std::vector<Frames> split_duplicates(Frames frames) {
  const auto forget = [](Frames& part, bool times, bool acquisitions) {
    for (DicomFrame& frame : part) {
      if (times) frame.trigger_time_ms.reset();
      if (acquisitions) frame.acquisition.reset();
    }
  };
  if (frames.front().placed) {
    sort_by_position(frames);
    if (has_doubles(frames)) {
      const bool by_time = std::ranges::any_of(
          frames, [](const DicomFrame& frame) { return frame.trigger_time_ms.has_value(); });
      auto parts = by_time ? split_by_trigger_time(frames) : std::vector<Frames>();
      const bool by_acquisition = parts.empty();
      if (by_acquisition) parts = split_by_acquisition(frames);
      for (Frames& part : parts) forget(part, by_acquisition, !by_acquisition);
      if (!parts.empty()) return parts;
    }
  }
  forget(frames, true, true);
  std::vector<Frames> whole;
  whole.push_back(std::move(frames));
  return whole;
}

}  // namespace palpate::volume_io
