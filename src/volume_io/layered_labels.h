#pragma once

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "volume_io/dicom_segments.h"
#include "volume_io/volume_message.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_source.h"
#include "volume_io/voxel_stream.h"

/// What the readers of labels share that make their voxels themselves, slice by slice, and whose structures
/// may overlap: segmentations and structure sets of DICOM, surfaces and masks. In the process that reads.
namespace palpate::volume_io {

/// Of labels, background included.
constexpr std::size_t kNumbers = 65536;

/// Which of some segments, by their indices, are in one voxel, and in how many voxels that is so
struct Meetings {
  std::set<std::pair<int, int>> pairs;
  std::uint64_t voxels = 0;
};

/// @param read_slice  (k, take): calls take(voxel of the slice, index) for each voxel that is in a segment
/// @param look        called now and then; false: nobody listens any more, and the rest is left out
template <class ReadSlice, class Look>
Result<Meetings> find_meetings(const GridGeometry& grid, const ReadSlice& read_slice, const Look& look) {
  Meetings meetings;
  // many meet in many voxels: most pairs are known
  constexpr int kKnown = 1024;
  std::vector<bool> known(std::size_t{kKnown} * kKnown);
  const auto meet = [&](int a, int b) {
    const auto [low, high] = std::minmax(a, b);
    if (high >= kKnown) return void(meetings.pairs.emplace(low, high));
    const std::size_t at = static_cast<std::size_t>(low) * kKnown + static_cast<std::size_t>(high);
    if (known[at]) return;
    known[at] = true;
    meetings.pairs.emplace(low, high);
  };
  constexpr std::size_t kLookEvery = 4096;
  std::size_t taken = 0;
  bool heard = true;
  // of each voxel the segments that it is in
  std::vector<std::vector<int>> in(static_cast<std::size_t>(grid.dims[0]) *
                                   static_cast<std::size_t>(grid.dims[1]));
  for (int k = 0; k < grid.dims[2]; ++k) {
    heard = heard && look();
    if (!heard) break;
    for (auto& voxel : in) voxel.clear();
    const auto read = read_slice(static_cast<std::size_t>(k), [&](std::size_t v, int index) {
      if (++taken % kLookEvery == 0) heard = heard && look();
      for (const int other : in[v]) meet(index, other);
      if (in[v].size() == 1) ++meetings.voxels;
      in[v].push_back(index);
    });
    if (!read) return read.error();
  }
  return meetings;
}

/// Puts segments into layers in which they do not meet, and says where they do.
std::vector<int> put_in_layers(std::size_t segments, const Meetings& meetings, VolumeFile& file);

/// Labels on a grid, of which the voxels are sent by send_layers().
VolumeFile labels_in_slices(const GridGeometry& grid, const std::filesystem::path& named);

/// The fields of a segment as Slicer has them.
/// @param name    empty: without one
/// @param colour  as colour_of_segment(); empty: without one
void put_segment(VolumeFile& file, std::size_t n, const std::string& name, int number, int layer,
                 const std::string& colour);

/// Names of structures, as many as a line bears.
std::string names_in_words(const std::vector<std::string>& names);

/// Layer after layer, slice after slice.
/// @param read_slice  (layer, k, take): calls take(voxel of the slice, label) for each voxel that has one
/// there
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
        const auto room = sink.room().first(bytes.size());
        std::memcpy(room.data(), bytes.data(), bytes.size());
        sink.put(bytes.size());
      }
    }
  return {};
}

/// What is read of one file of labels: first what it says, then its voxels as often as they are wanted.
template <class Understood, class Send>
bool read_labels_for(reader::ParentEnd& parent, const std::filesystem::path& named,
                     const Result<Understood>& understood, const Send& send) {
  if (!understood) return send_end(parent, understood.error());
  if (!send_end(parent, {})) return false;
  if (!send_volume(parent, understood->file, {&named, 1})) return false;
  while (parent.wait_for_word()) {
    VoxelSlots slots(parent);
    const auto read = send(slots);
    slots.drain();
    if (!send_end(parent, read)) return false;
  }
  return false;
}

/// Tells the parent that there is some progress
inline auto sign_of_life(reader::ParentEnd& parent) {
  return [&parent] {
    const std::uint32_t begun = 0;
    return parent.write(std::as_bytes(std::span(&begun, 1)));
  };
}

}  // namespace palpate::volume_io
