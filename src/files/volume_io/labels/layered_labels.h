#pragma once

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "volume_io/dicom/dicom_segments.h"
#include "volume_io/volume_message.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_source.h"
#include "volume_io/voxel_stream.h"

/// Shared by the readers of labels that generate voxels slice by slice and whose structures may overlap:
/// DICOM segmentations and structure sets, surfaces and masks. Runs in the reader process.
namespace palpate::volume_io {

/// Pairs of segment indices that share a voxel, and the number of voxels with more than one segment.
struct SegmentOverlapPairs {
  std::set<std::pair<int, int>> pairs;
  std::uint64_t voxels = 0;
};

/// Finds all overlapping pairs of segments.
/// @param read_slice       (k, take): calls take(voxel of the slice, index) for each voxel that is in a
///                         segment
/// @param should_continue  called regularly; false: the parent has gone, and the rest is skipped
template <class ReadSlice, class ShouldContinue>
Result<SegmentOverlapPairs> find_overlapping_pairs(const GridGeometry& grid, const ReadSlice& read_slice,
                                                   const ShouldContinue& should_continue) {
  SegmentOverlapPairs overlaps;
  // Many pairs share many voxels, so most pairs found are known already.
  constexpr int kKnown = 1024;
  std::vector<bool> known(std::size_t{kKnown} * kKnown);
  const auto add_overlap = [&](int a, int b) {
    const auto [low, high] = std::minmax(a, b);
    if (high >= kKnown) return void(overlaps.pairs.emplace(low, high));
    const std::size_t at = static_cast<std::size_t>(low) * kKnown + static_cast<std::size_t>(high);
    if (known[at]) return;
    known[at] = true;
    overlaps.pairs.emplace(low, high);
  };
  constexpr std::size_t kCheckEvery = 4096;
  std::size_t used = 0;
  bool parent_is_alive = true;
  // segments of each voxel
  std::vector<std::vector<int>> in(static_cast<std::size_t>(grid.dims[0]) *
                                   static_cast<std::size_t>(grid.dims[1]));
  for (int k = 0; k < grid.dims[2]; ++k) {
    parent_is_alive = parent_is_alive && should_continue();
    if (!parent_is_alive) break;
    for (auto& voxel : in) voxel.clear();
    const auto read = read_slice(static_cast<std::size_t>(k), [&](std::size_t v, int index) {
      if (++used % kCheckEvery == 0) parent_is_alive = parent_is_alive && should_continue();
      for (const int other : in[v]) add_overlap(index, other);
      if (in[v].size() == 1) ++overlaps.voxels;
      in[v].push_back(index);
    });
    if (!read) return read.error();
  }
  return overlaps;
}

/// Distributes segments over layers in which they do not overlap, and notes their overlaps in `file`.
std::vector<int> assign_layers(std::size_t segments, const SegmentOverlapPairs& overlaps, VolumeFile& file);

/// Label volume whose voxels are sent by send_layers().
VolumeFile labels_in_slices(const GridGeometry& grid, const std::filesystem::path& named);

/// Adds a segment in the form of Slicer's fields.
/// @param name    empty: unnamed
/// @param colour  as returned by colour_of_segment(); empty: none
void put_segment(VolumeFile& file, std::size_t n, const std::string& name, int number, int layer,
                 const std::string& colour);

/// List of structure names, as many as fit a line.
std::string names_in_words(const std::vector<std::string>& names);

/// Sends the voxels layer by layer, slice by slice.
/// @param read_slice  (layer, k, take): calls take(voxel of the slice, label) for each voxel with a label
template <class ReadSlice>
Result<void> send_layers(const VolumeHeader& header, const ReadSlice& read_slice, VoxelSink& sink) {
  const auto& dims = header.geometry.dims;
  std::vector<LabelId> slice(static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]));
  for (int layer = 0; layer < header.layers; ++layer)
    for (int k = 0; k < dims[2]; ++k) {
      std::fill(slice.begin(), slice.end(), LabelId{0});
      const auto read = read_slice(layer, static_cast<std::size_t>(k), [&](std::size_t v, int number) {
        slice[v] = static_cast<LabelId>(number);
      });
      if (!read) return read;
      sink.still_reading();
      for (std::size_t first = 0; first < slice.size(); first += kPieceValues) {
        const auto bytes = std::as_bytes(
            std::span(slice).subspan(first).first(std::min(kPieceValues, slice.size() - first)));
        const auto buffer = sink.buffer().first(bytes.size());
        std::memcpy(buffer.data(), bytes.data(), bytes.size());
        sink.commit(bytes.size());
      }
    }
  return {};
}

/// Reader process for one label file: sends its description, then its voxels at each request.
template <class Parsed, class Send>
bool serve_labels(reader::ParentEnd& parent, const std::filesystem::path& named, const Result<Parsed>& parsed,
                  const Send& send) {
  if (!parsed) return send_end(parent, parsed.error());
  if (!send_end(parent, {})) return false;
  if (!send_volume(parent, parsed->file, {&named, 1})) return false;
  while (parent.wait_for_grant()) {
    VoxelSlots slots(parent);
    const auto read = send(slots);
    slots.drain();
    if (!send_end(parent, read)) return false;
  }
  return false;
}

/// Callback that notifies the parent that the reader is alive.
inline auto sign_of_life(reader::ParentEnd& parent) {
  return [&parent] {
    const std::uint32_t begun = 0;
    return parent.write(std::as_bytes(std::span(&begun, 1)));
  };
}

}  // namespace palpate::volume_io
