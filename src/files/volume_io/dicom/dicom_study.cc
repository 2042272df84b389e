#include "volume_io/dicom/dicom_study.h"

#include <algorithm>

#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

std::string numbered(const std::vector<DicomVolume>& volumes, std::size_t n) {
  return "volume " + std::to_string(n + 1) + " (" + volumes[n].what + ")";
}

std::string relation_in_words(VolumeRelation relation, const std::string& volume) {
  switch (relation) {
    case VolumeRelation::kImages:
      return "was made on " + volume;
    case VolumeRelation::kSeries:
      return "was made on the series of " + volume;
    case VolumeRelation::kSpace:
      return "lies in the frame of reference of " + volume + "; it does not state the images it was made on";
    case VolumeRelation::kUnspecified:
      return "is assumed to be made on " + volume +
             ": the files do not state whether they share a frame of reference, and this was not checked";
    default:
      return "is in a different frame of reference from " + volume +
             ": their relative position is unknown, and they are taken as aligned because that volume was "
             "requested";
  }
}

}  // namespace

std::vector<VolumeRelation> relations_of(const DicomReference& segmentation,
                                         const std::vector<DicomVolume>& volumes,
                                         const DicomIdentifiers& identifiers) {
  std::vector<VolumeRelation> relations;
  for (const DicomVolume& volume : volumes) {
    // all frames of a volume share the series, and the frame of reference except in anonymised series
    const DicomFrame& first = volume.frames.front();
    const bool images = std::ranges::any_of(volume.frames, [&](const DicomFrame& frame) {
      return segmentation.images.contains(identifiers.of_file[frame.file]);
    });
    const std::string& series = identifiers.of_series[static_cast<std::size_t>(first.series)];
    if (images)
      relations.push_back(VolumeRelation::kImages);
    else if (segmentation.series.contains(series))
      relations.push_back(VolumeRelation::kSeries);
    else if (first.frame_of_reference.empty() || segmentation.frames_of_reference.empty())
      relations.push_back(VolumeRelation::kUnspecified);
    else
      relations.push_back(std::ranges::any_of(volume.frames,
                                              [&](const DicomFrame& frame) {
                                                return segmentation.frames_of_reference.contains(
                                                    frame.frame_of_reference);
                                              })
                              ? VolumeRelation::kSpace
                              : VolumeRelation::kNone);
  }
  return relations;
}

Result<SegmentedVolume> choose_segmented(const std::vector<DicomVolume>& volumes,
                                         const std::vector<VolumeRelation>& relations,
                                         std::optional<int> number) {
  const VolumeRelation closest = *std::ranges::min_element(relations);
  std::vector<std::size_t> best;
  for (std::size_t n = 0; n < relations.size(); ++n)
    if (relations[n] == closest) best.push_back(n);
  if (number) {
    const auto requested = choose_volume(volumes, number);
    if (!requested) return requested.error();
    SegmentedVolume chosen{*requested,
                           {relation_in_words(relations[*requested], numbered(volumes, *requested))},
                           relations[*requested] <= VolumeRelation::kSpace};
    if (relations[*requested] != closest)
      chosen.notes.insert(chosen.notes.begin(), relation_in_words(closest, numbered(volumes, best.front())) +
                                                    "; volume " + std::to_string(*number) + " was requested");
    return chosen;
  }
  if (closest == VolumeRelation::kNone)
    return bad_input("",
                     "was not made on these images: it is in a different frame of reference from each of "
                     "them (FrameOfReferenceUID (0020,0052)), so their relative position is unknown",
                     "give the images that it was made on; if both are known to be aligned, as after a "
                     "registration, choose a volume with --volume N");
  std::vector<std::size_t> usable;
  for (const std::size_t n : best)
    if (volumes[n].fault.empty()) usable.push_back(n);
  if (usable.empty())
    return bad_input("",
                     relation_in_words(closest, numbered(volumes, best.front())) +
                         ", which cannot be used: " + volumes[best.front()].fault,
                     volumes[best.front()].remedy);
  if (usable.size() > 1) {
    std::string list;
    constexpr std::size_t kListed = 10;
    for (std::size_t n = 0; n < std::min(usable.size(), kListed); ++n)
      list += (n ? "; " : " ") + std::to_string(usable[n] + 1) + ") " + volumes[usable[n]].what;
    if (usable.size() > kListed) list += "; and " + std::to_string(usable.size() - kListed) + " more";
    return bad_input("", "belongs to " + std::to_string(usable.size()) + " volumes equally:" + list,
                     "choose one with --volume N");
  }
  return SegmentedVolume{usable.front(),
                         {relation_in_words(closest, numbered(volumes, usable.front()))},
                         closest <= VolumeRelation::kSpace};
}

}  // namespace palpate::volume_io
