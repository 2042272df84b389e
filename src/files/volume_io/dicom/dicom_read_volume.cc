#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <map>
#include <set>
#include <utility>

#include "palpate/base/file.h"
#include "volume_io/dicom/dicom_process.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

struct DicomImage {
  std::uint32_t file;
  DicomFile content;
};

// number of occurrences of each description
using Counts = std::map<std::string, std::size_t>;

// True if two images with equal attributes have equal values; false if one of them is unreadable.
bool same_values(DicomLibrary& library, const FoundFiles& found, const DicomImage& one,
                 const DicomImage& other) {
  std::array<std::vector<std::int64_t>, 2> values;
  for (std::size_t n = 0; n < one.content.frames.size(); ++n) {
    for (const std::size_t which : {0, 1}) {
      const DicomImage& image = which == 0 ? one : other;
      const DicomFrame& frame = image.content.frames[n];
      const auto input = InputFile::open(found.files[image.file]);
      if (!input) return false;
      auto pixels = library.open_pixels(input->name_for_libraries());
      if (!pixels) return false;
      values[which].resize(static_cast<std::size_t>(frame.rows) * static_cast<std::size_t>(frame.columns));
      if (!(*pixels)->read(frame, values[which])) return false;
    }
    if (values[0] != values[1]) return false;
  }
  return true;
}

// Removes all but one of the copies of each image, as found in duplicated folders.
// @param should_continue  called before each comparison; false: the parent has gone
template <class ShouldContinue>
std::size_t drop_copies(DicomLibrary& library, const FoundFiles& found, std::vector<DicomImage>& images,
                        const ShouldContinue& should_continue) {
  std::map<std::string, std::vector<std::size_t>> of_uid;
  std::vector<char> is_copy(images.size());
  for (std::size_t n = 0; n < images.size(); ++n) {
    const DicomFile& content = images[n].content;
    if (content.sop_uid.empty() ||
        std::ranges::any_of(content.frames, [](const DicomFrame& frame) { return !frame.fault.empty(); }))
      continue;
    auto& before = of_uid[content.sop_uid];
    for (const std::size_t other : before) {
      if (images[other].content != content) continue;
      if (!should_continue()) return 0;
      if (same_values(library, found, images[other], images[n])) {
        is_copy[n] = 1;
        break;
      }
    }
    if (!is_copy[n]) before.push_back(n);
  }
  std::size_t n = 0;
  return std::erase_if(images, [&](const DicomImage&) { return is_copy[n++] != 0; });
}

// All frames, with the index of their series.
// @param identifiers  of_file must have one entry per file
std::vector<DicomFrame> frames_of(std::vector<DicomImage> images, DicomIdentifiers& identifiers) {
  // series ordered by SeriesNumber
  std::map<std::pair<int, std::string>, int> series;
  for (const DicomImage& image : images)
    series.emplace(std::pair(image.content.series_number, image.content.series_uid), 0);
  for (auto& [key, index] : series) {
    index = static_cast<int>(identifiers.of_series.size());
    identifiers.of_series.push_back(key.second);
  }
  std::vector<DicomFrame> frames;
  for (DicomImage& image : images) {
    identifiers.of_file[image.file] = image.content.sop_uid;
    for (DicomFrame& frame : image.content.frames) {
      frame.file = image.file;
      frame.series = series[{image.content.series_number, image.content.series_uid}];
      frames.push_back(std::move(frame));
    }
  }
  return frames;
}

// @param should_continue  called with the index of the file to be read, and with the number of files when all
//                         are done; false: the parent has gone
template <class ShouldContinue>
Result<DicomContent> inspect(DicomLibrary& library, const FoundFiles& found,
                             const ShouldContinue& should_continue) {
  std::vector<DicomImage> images;
  std::size_t others = 0, without_image = 0;
  Counts kinds, damages;
  std::optional<Error> first;
  const auto leave_out = [&](const Error& why) {
    ++damages[why.what];
    if (!first) first = why;
  };
  for (std::size_t n = 0; n < found.files.size(); ++n) {
    if (!should_continue(n)) break;
    const auto opened = InputFile::open(found.files[n]);
    std::string front(kKindBytes, '\0');
    const auto received =
        opened ? opened->read_at(0, std::as_writable_bytes(std::span(front))) : opened.error();
    if (!received) {
      leave_out(bad_input("", "cannot be read", "check that you have permission to read it"));
      continue;
    }
    front.resize(*received);
    const auto kind = dicom_kind_of(found.files[n], front);
    if (!kind) {
      ++others;
    } else if (!kind->dicom_image) {
      ++kinds[kind->what];
    } else if (auto content = library.read_file(opened->name_for_libraries(), dicom_transfer_syntax(front))) {
      images.push_back({static_cast<std::uint32_t>(n), *std::move(content)});
    } else if (content.error().what == kNoDicomImage) {
      ++without_image;
    } else {
      leave_out(content.error());
    }
  }
  const auto all_done = [&] { return should_continue(found.files.size()); };
  const std::size_t copies = drop_copies(library, found, images, all_done);
  DicomContent content;
  content.identifiers.of_file.resize(found.files.size());
  std::vector<DicomFrame> frames = frames_of(std::move(images), content.identifiers);
  content.notes = found.notes;
  if (copies > 0)
    content.notes.push_back(counted(copies, "file is an exact copy of another one and was",
                                    "files are exact copies of others and were") +
                            " left out");
  for (const auto& [what, count] : damages)
    content.notes.push_back("left out: " + counted(count, "file that ", "files of which each ") + what +
                            "; if one was the first or the last slice of a volume, that slice is missing "
                            "without another message");
  for (const auto& [what, count] : kinds)
    content.others.push_back(count == 1 ? what : what + ", " + std::to_string(count) + " files");
  if (without_image > 0)
    content.others.push_back(
        counted(without_image, "DICOM file without an image", "DICOM files without an image"));
  if (others > 0) content.others.push_back(counted(others, "other file", "other files"));
  if (frames.empty())
    return first && found.files.size() == 1 ? Error(*first)
                                            : bad_input("",
                                                        "holds no DICOM image that can be read" +
                                                            (first ? ": each " + first->what : std::string()),
                                                        "name a volume, or a folder with a series of images");
  content.volumes = sort_into_volumes(std::move(frames));
  return content;
}

// True if the stored values can be sent unchanged: one type and one scale for all slices, and no padding.
bool as_stored(const std::vector<DicomFrame>& frames) {
  const DicomFrame& first = frames.front();
  return std::all_of(frames.begin(), frames.end(), [&](const DicomFrame& frame) {
    return frame.bits_allocated == first.bits_allocated && frame.is_signed == first.is_signed &&
           frame.slope == first.slope && frame.intercept == first.intercept && !frame.padding;
  });
}

Component stored_component(const DicomFrame& frame) {
  switch (frame.bits_allocated) {
    case 8:
      return frame.is_signed ? Component::kInt8 : Component::kUint8;
    case 16:
      return frame.is_signed ? Component::kInt16 : Component::kUint16;
    default:
      return frame.is_signed ? Component::kInt32 : Component::kUint32;
  }
}

VolumeFile volume_of(const DicomVolume& volume, const fs::path& named, std::vector<std::string> notes) {
  VolumeFile file;
  file.header.geometry = volume.geometry;
  file.header.meaning = ValueMeaning::kMeasured;
  file.voxels.file = named;
  file.voxels.encoding = Encoding::kSlices;
  const DicomFrame& first = volume.frames.front();
  if (as_stored(volume.frames)) {
    file.voxels.component = stored_component(first);
    file.voxels.slope = first.slope;
    file.voxels.intercept = first.intercept;
  } else {
    file.voxels.component = Component::kFloat32;
  }
  file.padded = std::any_of(volume.frames.begin(), volume.frames.end(),
                            [](const DicomFrame& frame) { return frame.padding.has_value(); });
  file.notes = std::move(notes);
  if (is_lossy(volume))
    file.notes.push_back("was compressed with loss: its values only approximate the measured ones");
  return file;
}

bool is_padding(std::int64_t stored, const DicomFrame& frame) {
  if (!frame.padding) return false;
  const auto [low, high] = std::minmax({*frame.padding, frame.padding_limit.value_or(*frame.padding)});
  return stored >= low && stored <= high;
}

template <class Value>
void send_values(std::span<const std::int64_t> values, const DicomFrame& frame, VoxelSink& sink) {
  for (std::size_t first = 0; first < values.size();) {
    const std::size_t count = std::min(values.size() - first, kPieceValues);
    const auto buffer = sink.buffer().first(count * sizeof(Value));
    for (std::size_t n = 0; n < count; ++n) {
      const std::int64_t stored = values[first + n];
      Value value;
      if constexpr (std::is_floating_point_v<Value>)
        value = is_padding(stored, frame)
                    ? std::numeric_limits<Value>::quiet_NaN()
                    : static_cast<Value>(frame.slope * static_cast<double>(stored) + frame.intercept);
      else
        value = static_cast<Value>(stored);
      std::memcpy(buffer.data() + n * sizeof(Value), &value, sizeof value);
    }
    sink.commit(buffer.size());
    first += count;
  }
}

// slice by slice; a multi-frame file is opened once
Result<void> send_slices(DicomLibrary& library, const DicomVolume& volume, const FoundFiles& found,
                         Component component, VoxelSink& sink) {
  std::optional<InputFile> file;
  std::unique_ptr<DicomPixels> pixels;
  std::uint32_t opened = 0;
  std::vector<std::int64_t> values;
  for (std::size_t n = 0; n < volume.frames.size(); ++n) {
    const DicomFrame& frame = volume.frames[n];
    const auto here = [&](const Error& error) {
      return bad_input("", slice_in_words(volume.frames, n) + ", " + error.what, error.remedy);
    };
    if (!pixels || opened != frame.file) {
      pixels.reset();
      auto input = InputFile::open(found.files[frame.file]);
      if (!input)
        return here(bad_input("", "can no longer be read", "do not change the files while they are read"));
      file = *std::move(input);
      auto content = library.open_pixels(file->name_for_libraries());
      if (!content) return here(content.error());
      pixels = *std::move(content);
      opened = frame.file;
    }
    values.resize(static_cast<std::size_t>(frame.rows) * static_cast<std::size_t>(frame.columns));
    if (auto read = pixels->read(frame, values); !read) return here(read.error());
    with_type(component, [&](auto type) { send_values<decltype(type)>(values, frame, sink); });
  }
  return {};
}

bool serve_dicom_volume(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found,
                        const fs::path& named, std::optional<int> number) {
  const auto content = find_content(library, parent, found);
  if (!content) return send_end(parent, content.error());
  const auto chosen = choose_volume(content->volumes, number);
  if (!chosen) return send_end(parent, chosen.error());
  if (!send_end(parent, {})) return false;
  const DicomVolume& volume = content->volumes[*chosen];
  std::vector<std::string> notes = content->notes;
  notes.insert(notes.end(), volume.notes.begin(), volume.notes.end());
  const VolumeFile file = volume_of(volume, named, std::move(notes));
  if (!send_volume(parent, file, {&named, 1})) return false;
  while (parent.wait_for_grant()) {
    VoxelSlots slots(parent);
    const auto read = send_slices(library, volume, found, file.voxels.component, slots);
    slots.drain();
    if (!send_end(parent, read)) return false;
  }
  return false;
}

// Maximum number of volumes in a list: a folder of images that are each a series of its own has thousands.
constexpr std::size_t kMaxListed = 2000;

bool serve_dicom_list(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found) {
  const auto content = find_content(library, parent, found);
  if (!content) return send_end(parent, content.error());
  if (!send_end(parent, {})) return false;
  reader::Sender out(parent);
  const std::size_t listed = std::min(content->volumes.size(), kMaxListed);
  out.put(static_cast<std::uint32_t>(listed));
  for (const DicomVolume& volume : std::span(content->volumes).first(listed)) {
    out.put(volume.what);
    out.put(volume.fault);
    out.put(volume.remedy);
  }
  std::vector<std::string> notes = content->notes;
  for (std::size_t n = 0; n < listed && notes.size() < kMaxListed / 2; ++n)
    for (const std::string& note : content->volumes[n].notes)
      notes.push_back((content->volumes.size() == 1 ? "" : "volume " + std::to_string(n + 1) + " ") + note);
  for (const std::string& other : content->others) notes.push_back("besides: " + other);
  if (listed < content->volumes.size())
    notes.push_back("and " + std::to_string(content->volumes.size() - listed) + " more volumes");
  out.put(static_cast<std::uint32_t>(notes.size()));
  for (const std::string& note : notes) out.put(note);
  return out.ok();
}

bool send_identity(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found,
                   std::optional<int> number) {
  const auto content = find_content(library, parent, found);
  if (!content) return send_end(parent, content.error());
  const auto chosen = choose_volume(content->volumes, number);
  if (!chosen) return send_end(parent, chosen.error());
  const DicomVolume& volume = content->volumes[*chosen];
  const auto opened = InputFile::open(found.files[volume.frames.front().file]);
  if (!opened) return send_end(parent, opened.error());
  const auto identity = library.read_identity(opened->name_for_libraries());
  if (!identity) return send_end(parent, identity.error());
  std::set<std::string> images;
  for (const DicomFrame& frame : volume.frames) images.insert(content->identifiers.of_file[frame.file]);
  if (!send_end(parent, {})) return false;
  reader::Sender out(parent);
  out.put(static_cast<std::uint32_t>(identity->attributes.size()));
  for (const auto& [tag, value] : identity->attributes) {
    out.put(tag.first);
    out.put(tag.second);
    out.put(value);
  }
  for (const std::string* text :
       {&identity->frame_of_reference, &identity->series, &identity->images[0].first})
    out.put(*text);
  out.put(static_cast<std::uint32_t>(images.size()));
  for (const std::string& image : images) out.put(image);
  return out.ok();
}

}  // namespace

std::string counted(std::size_t count, const std::string& what, const std::string& several) {
  return std::to_string(count) + " " + (count == 1 ? what : several);
}

Result<DicomContent> find_content(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found) {
  library.begin_reading();
  return inspect(library, found, [&](std::size_t begun) {
    const auto number = static_cast<std::uint32_t>(begun);
    return parent.write(std::as_bytes(std::span(&number, 1)));
  });
}

Result<DicomIdentity> identity_of_study(const DicomAttachment& attached, const Progress& progress) {
  const fs::path& study = attached.study;
  const auto library = ready_dicom_library();
  if (!library) return at_file(study, library.error());
  if (!is_dicom(study))
    return bad_input(study.string(), "holds no DICOM image, so nothing can be attached to it",
                     "give the study: a DICOM folder or file");
  const auto found = find_files(study, progress);
  if (!found) return found.error();
  auto process = start_dicom_reader(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return send_identity(**library, parent, *found, attached.volume);
  });
  if (!process) return at_file(study, process.error());
  const Files named{&study, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  DicomIdentity identity;
  std::uint32_t attributes = 0, images = 0;
  in.get(attributes);
  constexpr std::uint32_t kMaxAttributes = 100;
  if (attributes > kMaxAttributes) return impossible_volume(named);
  for (std::uint32_t n = 0; n < attributes && in.ok(); ++n) {
    auto& [tag, value] = identity.attributes.emplace_back();
    in.get(tag.first);
    in.get(tag.second);
    in.get(value);
  }
  std::string sop_class;
  for (std::string* text : {&identity.frame_of_reference, &identity.series, &sop_class}) in.get(*text);
  in.get(images);
  if (images > kMaxDicomFiles) return impossible_volume(named);
  for (std::uint32_t n = 0; n < images && in.ok(); ++n) {
    identity.images.emplace_back(sop_class, "");
    in.get(identity.images.back().second);
  }
  if (!in.ok()) return about(in.error(), named);
  return identity;
}

Result<DicomReader> open_dicom(const fs::path& file, std::optional<int> number, const Progress& progress) {
  const auto library = ready_dicom_library();
  if (!library) return at_file(file, library.error());
  const auto found = find_files(file, progress);
  if (!found) return found.error();
  auto process = start_dicom_reader(*found, kSlots * kSlotBytes, progress, [&](reader::ParentEnd& parent) {
    return serve_dicom_volume(**library, parent, *found, file, number);
  });
  if (!process) return at_file(file, process.error());
  const Files named{&file, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  auto answer = receive_answer(**process, named);
  if (!answer) return answer.error();
  auto* volume = std::get_if<VolumeFile>(&*answer);
  if (!volume || volume->voxels.encoding != Encoding::kSlices) return impossible_volume(named);
  return DicomReader{*std::move(process), std::move(*volume)};
}

}  // namespace palpate::volume_io

namespace palpate {

namespace fs = std::filesystem;
using namespace volume_io;

Result<VolumeList> list_volumes(const std::filesystem::path& file, const Progress& progress) try {
  PALPATE_CHECK(is_dicom(file));
  const auto library = ready_dicom_library();
  if (!library) return at_file(file, library.error());
  const auto found = find_files(file, progress);
  if (!found) return found.error();
  auto process = start_dicom_reader(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return serve_dicom_list(**library, parent, *found);
  });
  if (!process) return at_file(file, process.error());
  const Files named{&file, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  VolumeList list;
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxListed) return impossible_volume(named);
  for (std::uint32_t n = 0; n < count && in.ok(); ++n) {
    auto& volume = list.volumes.emplace_back();
    in.get(volume.what);
    in.get(volume.fault);
    in.get(volume.remedy);
  }
  std::uint32_t notes = 0;
  in.get(notes);
  if (notes > kMaxListed) return impossible_volume(named);
  for (std::uint32_t n = 0; n < notes && in.ok(); ++n) in.get(list.notes.emplace_back());
  if (!in.ok()) return about(in.error(), named);
  return list;
} catch (const std::bad_alloc&) {
  return bad_input(file.string(), "does not fit into the memory",
                   "close other programs, or choose a smaller folder");
}

}  // namespace palpate
