#include "volume_io/dicom.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <map>
#include <set>
#include <tuple>
#include <utility>

#include "palpate/base/file.h"
#include "palpate/base/reading.h"
#include "palpate/volume_io/identifiers.h"
#include "volume_io/dicom_file.h"
#include "volume_io/dicom_study.h"
#include "volume_io/dicom_volumes.h"
#include "volume_io/formats.h"
#include "volume_io/label_text.h"
#include "volume_io/layered_labels.h"
#include "volume_io/structure_files.h"
#include "volume_io/volume_message.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

// ---- finding files ------------------------------------------------------------------------------

constexpr std::size_t kMaxDicomFiles = 200'000;
constexpr int kDeepestFolder = 16;

// Calls visit(file) for each regular file in a folder or below it, until it returns true. Links that leave
// the folder are skipped unless they are allowed; returns their number.
template <class Visit>
std::size_t walk(const fs::path& folder, const Visit& visit) {
  std::size_t led_out = 0;
  std::error_code failed;
  fs::recursive_directory_iterator entry(folder, fs::directory_options::skip_permission_denied, failed);
  for (; !failed && entry != fs::recursive_directory_iterator(); entry.increment(failed)) {
    if (entry.depth() >= kDeepestFolder) entry.disable_recursion_pending();
    std::error_code ignored;
    if (!entry->is_regular_file(ignored)) continue;
    if (entry->is_symlink(ignored) && !check_stays_in(folder, entry->path()))
      ++led_out;
    else if (visit(entry->path()))
      break;
  }
  return led_out;
}

std::string front_of(const fs::path& file) {
  auto front = read_front(file, Encoding::kRaw, kKindBytes);
  return front ? *std::move(front) : std::string();
}

std::optional<FileKind> dicom_kind_of(const fs::path& file, std::string_view front) {
  // Without the DICM prefix the content is ambiguous; a file with the extension of another format is then not
  // DICOM.
  const bool marked = front.size() > 132 && front.substr(128, 4) == "DICM";
  if (!marked && format_of(file)) return std::nullopt;
  auto kind = kind_of(front, "", 0);
  if (!kind || !kind->dicom) return std::nullopt;
  return kind;
}

bool is_dicom_image(const fs::path& file) {
  const auto kind = dicom_kind_of(file, front_of(file));
  return kind && kind->dicom_image;
}

bool is_dicom_directory(const fs::path& file) {
  const auto kind = dicom_kind_of(file, front_of(file));
  return kind && kind->dicom_directory;
}

// files for the reader process
struct FoundFiles {
  std::vector<fs::path> files;  // ordered by name; the order has no effect
  std::vector<fs::path> roots;  // files and folders that the process may open, with their contents
  std::vector<std::string> notes;
};

// Files referenced by a DICOMDIR. Errors: interrupted; a damaged DICOMDIR; a reference to a file elsewhere.
Result<FoundFiles> files_named_by(const fs::path& directory, const Progress& progress);

// Files to be read for a named file or folder. Errors: interrupted; those of a DICOMDIR.
Result<FoundFiles> find_files(const fs::path& named, const Progress& progress) {
  FoundFiles found;
  found.roots.push_back(named);
  std::error_code ignored;
  if (!fs::is_directory(named, ignored)) {
    if (is_dicom_directory(named)) return files_named_by(named, progress);
    found.files.push_back(named);
    return found;
  }
  constexpr std::size_t kMaxRoots = 32;
  bool more = false, stopped = false;
  std::set<fs::path> outside;
  const std::size_t led_out = walk(named, [&](const fs::path& file) {
    if ((stopped = progress.stopped())) return true;
    if (found.files.size() == kMaxDicomFiles) return more = true;
    std::error_code unknown;
    // targets of allowed links
    if (reading_limits().follow_links && outside.size() < kMaxRoots && fs::is_symlink(file, unknown))
      outside.insert(fs::canonical(file, unknown).parent_path());
    found.files.push_back(file);
    return false;
  });
  if (stopped) return Progress::interrupted();
  found.roots.insert(found.roots.end(), outside.begin(), outside.end());
  std::sort(found.files.begin(), found.files.end());
  if (more)
    found.notes.push_back("holds more than " + std::to_string(kMaxDicomFiles) +
                          " files; the others were ignored");
  if (led_out > 0)
    found.notes.push_back(std::to_string(led_out) + (led_out == 1 ? " link leads" : " links lead") +
                          " out of the folder and was not followed (--follow-links allows it)");
  return found;
}

// ---- in the reader process ----------------------------------------------------------------------

struct DicomContent {
  std::vector<DicomVolume> volumes;
  std::vector<std::string> notes;   // about data that may be missing in a volume
  std::vector<std::string> others;  // descriptions of other contents
  DicomIdentifiers identifiers;
};

std::string counted(std::size_t count, const std::string& what, const std::string& several) {
  return std::to_string(count) + " " + (count == 1 ? what : several);
}

struct Image {
  std::uint32_t file;
  DicomFile content;
};

// number of occurrences of each description
using Counts = std::map<std::string, std::size_t>;

// True if two images with equal attributes have equal values; false if one of them is unreadable.
bool same_values(DicomLibrary& library, const FoundFiles& found, const Image& one, const Image& other) {
  std::array<std::vector<std::int64_t>, 2> values;
  for (std::size_t n = 0; n < one.content.frames.size(); ++n) {
    for (const std::size_t which : {0, 1}) {
      const Image& image = which == 0 ? one : other;
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
std::size_t drop_copies(DicomLibrary& library, const FoundFiles& found, std::vector<Image>& images,
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
  return std::erase_if(images, [&](const Image&) { return is_copy[n++] != 0; });
}

// All frames, with the index of their series.
// @param identifiers  of_file must have one entry per file
std::vector<DicomFrame> frames_of(std::vector<Image> images, DicomIdentifiers& identifiers) {
  // series ordered by SeriesNumber
  std::map<std::pair<int, std::string>, int> series;
  for (const Image& image : images)
    series.emplace(std::pair(image.content.series_number, image.content.series_uid), 0);
  for (auto& [key, index] : series) {
    index = static_cast<int>(identifiers.of_series.size());
    identifiers.of_series.push_back(key.second);
  }
  std::vector<DicomFrame> frames;
  for (Image& image : images) {
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
// are done;
//              false: the parent has gone
template <class ShouldContinue>
Result<DicomContent> inspect(DicomLibrary& library, const FoundFiles& found,
                             const ShouldContinue& should_continue) {
  std::vector<Image> images;
  std::size_t others = 0, pictureless = 0;
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
      ++pictureless;
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
  if (pictureless > 0)
    content.others.push_back(
        counted(pictureless, "DICOM file without an image", "DICOM files without an image"));
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

Result<DicomContent> find_content(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found) {
  library.begin_reading();
  return inspect(library, found, [&](std::size_t begun) {
    const auto number = static_cast<std::uint32_t>(begun);
    return parent.write(std::as_bytes(std::span(&number, 1)));
  });
}

// ---- segmentations, in the reader process ---------------------------------------------------------

// a parsed segmentation
struct Segments {
  std::vector<fs::path> files;  // indexed by DicomFrame::file
  DicomSegmentation declared;
  SegmentGrid grid;
  std::vector<std::vector<std::size_t>> frames_at;  // frame indices, by slice
  std::vector<int> layer_of_number;                 // indexed by segment number
  VolumeFile file;
};

// maximum number of files of one segmentation, all of which are open at the same time
constexpr std::size_t kMaxSegmentationFiles = 200;

// adds the file to an error if a segmentation has several
Error in_file(Error error, const std::vector<fs::path>& files, std::size_t n) {
  if (files.size() > 1) error.where = files[n].string();
  return error;
}

// decoder for the frames of a segmentation; each file is opened once
class SegmentPixels {
 public:
  static Result<SegmentPixels> open(DicomLibrary& library, const std::vector<fs::path>& files) {
    SegmentPixels all;
    all.files_ = &files;
    for (std::size_t n = 0; n < files.size(); ++n) {
      auto input = InputFile::open(files[n]);
      if (!input) return in_file(input.error(), files, n);
      auto pixels = library.open_pixels(input->name_for_libraries());
      if (!pixels) return in_file(pixels.error(), files, n);
      all.opened_.push_back({*std::move(input), *std::move(pixels)});
    }
    return all;
  }
  // calls take(voxel, segment number) for each voxel that is in a segment
  template <class Take>
  Result<void> read(const DicomSegmentation& segmentation, std::size_t n, const Take& take) {
    const DicomFrame& frame = segmentation.frames[n];
    values_.resize(static_cast<std::size_t>(frame.rows) * static_cast<std::size_t>(frame.columns));
    if (auto read = opened_[frame.file].pixels->read(frame, values_); !read)
      return in_file(bad_input("", "frame " + std::to_string(frame.frame + 1) + " " + read.error().what,
                               read.error().remedy),
                     *files_, frame.file);
    const int segment = segmentation.segment_of_frame[n];
    const SegmentCoding& coding = segmentation.codings[frame.file];
    for (std::size_t v = 0; v < values_.size(); ++v) {
      const std::int64_t value = values_[v];
      switch (coding.kind) {
        case SegmentCoding::Kind::kBinary:
          if (value != 0) take(v, segment);
          break;
        case SegmentCoding::Kind::kFractional:
          if (value > 0 && 2 * value >= coding.most) take(v, segment);
          break;
        case SegmentCoding::Kind::kLabels:
          if (value != 0 && value != coding.nothing &&
              value + coding.number_offset < std::int64_t{kLabelValues})
            take(v, static_cast<int>(value) + coding.number_offset);
          break;
      }
    }
    return {};
  }

 private:
  struct Opened {
    InputFile file;
    std::unique_ptr<DicomPixels> pixels;
  };
  const std::vector<fs::path>* files_ = nullptr;
  std::vector<Opened> opened_;
  std::vector<std::int64_t> values_;
};

// @param should_continue  called before each slice; false: the parent has gone
template <class ShouldContinue>
Result<void> find_overlaps(DicomLibrary& library, Segments& segments, const ShouldContinue& should_continue) {
  const DicomSegmentation& segmentation = segments.declared;
  std::vector<int> index_of_number(kLabelValues, -1);
  for (std::size_t n = 0; n < segmentation.segments.size(); ++n)
    index_of_number[static_cast<std::size_t>(segmentation.segments[n].number)] = static_cast<int>(n);
  SegmentOverlapPairs meetings;
  // the labels of a single file are mutually exclusive
  if (segmentation.codings.size() > 1 || segmentation.codings.front().kind != SegmentCoding::Kind::kLabels) {
    auto pixels = SegmentPixels::open(library, segments.files);
    if (!pixels) return pixels.error();
    const auto read_slice = [&](std::size_t k, const auto& take) -> Result<void> {
      const auto& frames = segments.frames_at[k];
      if (frames.size() < 2) return {};
      for (const std::size_t n : frames) {
        const auto read = pixels->read(segmentation, n, [&](std::size_t v, int segment) {
          if (const int index = index_of_number[static_cast<std::size_t>(segment)]; index >= 0)
            take(v, index);
        });
        if (!read) return read;
      }
      return {};
    };
    auto found = find_overlapping_pairs(segments.grid.geometry, read_slice, should_continue);
    if (!found) return found.error();
    meetings = *std::move(found);
  }
  const auto layers = assign_layers(segmentation.segments.size(), meetings, segments.file);
  for (std::size_t n = 0; n < layers.size(); ++n)
    segments.layer_of_number[static_cast<std::size_t>(segmentation.segments[n].number)] = layers[n];
  return {};
}

Result<DicomSegmentation> read_segmentation_file(DicomLibrary& library, const fs::path& file) {
  const auto opened = InputFile::open(file);
  if (!opened) return opened.error();
  std::string front(kKindBytes, '\0');
  const auto received = opened->read_at(0, std::as_writable_bytes(std::span(front)));
  front.resize(received ? *received : 0);
  auto declared = library.read_segmentation(opened->name_for_libraries(), dicom_transfer_syntax(front));
  if (!declared) return declared.error();
  std::erase_if(declared->segments, [](const DicomSegment& segment) { return is_background(segment); });
  std::set<int> numbers;
  for (const DicomSegment& segment : declared->segments)
    if (segment.number < 1 || segment.number >= static_cast<int>(kLabelValues) ||
        !numbers.insert(segment.number).second)
      return bad_input("", "has a SegmentNumber (0062,0004) that is 0 or repeated", "export it again");
  return declared;
}

// @param should_continue  called regularly; false: the parent has gone
template <class ShouldContinue>
Result<Segments> inspect_segments(DicomLibrary& library, const std::vector<fs::path>& files,
                                  const fs::path& named, const ShouldContinue& should_continue) {
  library.begin_reading();
  Segments segments;
  segments.files = files;
  std::vector<DicomSegmentation> parts;
  std::set<std::string> series;
  for (std::size_t n = 0; n < files.size(); ++n) {
    if (!should_continue()) break;
    auto part = read_segmentation_file(library, files[n]);
    if (!part) return in_file(part.error(), files, n);
    series.insert(part->series_uid);
    parts.push_back(*std::move(part));
  }
  segments.declared = join_segmentations(std::move(parts));
  const DicomSegmentation& segmentation = segments.declared;
  if (std::ranges::any_of(segmentation.segments, [](const auto& segment) {
        return segment.number >= static_cast<int>(kLabelValues);
      }))
    return bad_input("", "has more segments than label numbers", "read fewer of its files at a time");
  auto grid = lay_segments(segmentation);
  if (!grid) return grid.error();
  segments.grid = *std::move(grid);
  segments.frames_at.resize(static_cast<std::size_t>(segments.grid.geometry.dims[2]));
  for (std::size_t n = 0; n < segmentation.frames.size(); ++n)
    segments.frames_at[static_cast<std::size_t>(segments.grid.slice_of_frame[n])].push_back(n);
  segments.layer_of_number.assign(kLabelValues, 0);
  segments.file = labels_in_slices(segments.grid.geometry, named);
  if (auto found = find_overlaps(library, segments, should_continue); !found) return found.error();
  auto& notes = segments.file.notes;
  notes.insert(notes.end(), segments.grid.notes.begin(), segments.grid.notes.end());
  if (files.size() > 1)
    notes.push_back("is spread over " + std::to_string(files.size()) + " files of " +
                    counted(series.size(), "series", "series") +
                    ", which are read as one segmentation with " +
                    counted(segmentation.segments.size(), "segment", "segments"));
  if (std::ranges::any_of(segmentation.codings, [](const SegmentCoding& coding) {
        return coding.kind == SegmentCoding::Kind::kFractional;
      }))
    notes.push_back(
        "is fractional: a voxel belongs to a segment at half of MaximumFractionalValue (0062,000E) or more");
  std::vector<std::string> names;
  for (std::size_t n = 0; n < segmentation.segments.size(); ++n) {
    const DicomSegment& segment = segmentation.segments[n];
    std::string name = name_of_segment(segment);
    // several files may use the same names
    if (files.size() > 1) name = unique_name(std::move(name), names);
    names.push_back(name);
    put_segment(segments.file, n, name, segment.number,
                segments.layer_of_number[static_cast<std::size_t>(segment.number)],
                colour_of_segment(segment));
  }
  return segments;
}

Result<void> send_segments(DicomLibrary& library, const Segments& segments, VoxelSink& sink) {
  auto pixels = SegmentPixels::open(library, segments.files);
  if (!pixels) return pixels.error();
  const auto read_slice = [&](int layer, std::size_t k, const auto& take) -> Result<void> {
    for (const std::size_t n : segments.frames_at[k]) {
      const auto in_layer = [&](int segment) {
        return segments.layer_of_number[static_cast<std::size_t>(segment)] == layer;
      };
      // 0: a label map, whose labels may be in different layers
      const int only = segments.declared.segment_of_frame[n];
      if (only != 0 && !in_layer(only)) continue;
      const auto read = pixels->read(segments.declared, n, [&](std::size_t v, int segment) {
        if (in_layer(segment)) take(v, segment);
      });
      if (!read) return read;
    }
    return {};
  };
  return send_layers(segments.file.header, read_slice, sink);
}

// ---- structure sets, in the reader process ------------------------------------------------------

// contours rasterised on the grid of a scan
struct Structures {
  std::vector<DicomStructure> declared;  // the structures with closed contours, which have moved to `planes`
  std::vector<StructurePlanes> planes;
  std::vector<int> layers;
  VolumeFile file;
};

std::string colour_of_structure(const DicomStructure& structure) {
  std::string text;
  if (structure.colour)
    for (const std::uint8_t part : *structure.colour)
      text += (text.empty() ? "" : " ") + std::to_string(static_cast<double>(part) / 255);
  return text;
}

// notes for the user: missing contours, filled gaps, clipped and empty structures
void note_structures(const Structures& structures, const std::vector<std::string>& without_contours,
                     std::size_t left_out, const std::vector<std::uint64_t>& voxels, VolumeFile& file) {
  std::vector<std::string> cut, empty;
  std::size_t bridged = 0;
  std::vector<std::string> with_gaps;
  for (std::size_t n = 0; n < structures.planes.size(); ++n) {
    const std::string name = name_of_segment(structures.declared[n].segment);
    if (structures.planes[n].bridged() > 0) with_gaps.push_back(name);
    bridged += structures.planes[n].bridged();
    if (voxels[n] == 0)
      empty.push_back(name);
    else if (structures.planes[n].is_cut())
      cut.push_back(name);
  }
  const auto warn_about = [&](const std::string& what, const std::vector<std::string>& names) {
    if (!names.empty()) file.notes.push_back(what + ": " + names_in_words(names));
  };
  warn_about("has structures without a closed contour, which were left out", without_contours);
  if (left_out > 0)
    file.notes.push_back(counted(left_out, "contour is open, a point or less than a triangle, and was",
                                 "contours are open, points or less than a triangle, and were") +
                         " left out");
  warn_about("lacks contours in " + counted(bridged, "plane", "planes") +
                 " between others, where the contours of the nearest plane are used",
             with_gaps);
  warn_about("has structures that extend beyond the scan and are cut off there", cut);
  warn_about("has structures that contain no voxel centre or lie outside the scan", empty);
}

// @param should_continue  called regularly; false: the parent has gone
template <class ShouldContinue>
Result<Structures> inspect_structures(DicomLibrary& library, const fs::path& named, const GridGeometry& grid,
                                      const ShouldContinue& should_continue) {
  library.begin_reading();
  Structures structures;
  std::vector<std::string> without_contours;
  std::size_t left_out = 0;
  const auto opened = InputFile::open(named);
  if (!opened) return opened.error();
  auto declared = library.read_structures(opened->name_for_libraries());
  if (!declared) return declared.error();
  if (declared->size() >= kLabelValues)
    return bad_input("", "has more structures than label numbers", "export fewer of them");
  for (DicomStructure& structure : *declared) {
    left_out += structure.left_out;
    if (structure.contours.empty()) {
      without_contours.push_back(name_of_segment(structure.segment));
      continue;
    }
    if (!should_continue()) break;
    auto planes = StructurePlanes::make(structure, grid);
    if (!planes) return planes.error();
    structures.planes.push_back(*std::move(planes));
    structure.contours.clear();
    structures.declared.push_back(std::move(structure));
  }

  std::vector<std::uint64_t> voxels(structures.planes.size());
  const auto read_slice = [&](std::size_t k, const auto& take) -> Result<void> {
    for (std::size_t n = 0; n < structures.planes.size(); ++n)
      structures.planes[n].read_slice(static_cast<int>(k), [&](std::size_t v) {
        ++voxels[n];
        take(v, static_cast<int>(n));
      });
    return {};
  };
  const auto meetings = find_overlapping_pairs(grid, read_slice, should_continue);
  if (!meetings) return meetings.error();
  structures.file = labels_in_slices(grid, named);
  structures.layers = assign_layers(structures.planes.size(), *meetings, structures.file);
  note_structures(structures, without_contours, left_out, voxels, structures.file);
  for (std::size_t n = 0; n < structures.declared.size(); ++n)
    put_segment(structures.file, n, name_of_segment(structures.declared[n].segment),
                structures.declared[n].segment.number, structures.layers[n],
                colour_of_structure(structures.declared[n]));
  return structures;
}

Result<void> send_structures(const Structures& structures, VoxelSink& sink) {
  const auto read_slice = [&](int layer, std::size_t k, const auto& take) -> Result<void> {
    for (std::size_t n = 0; n < structures.planes.size(); ++n)
      if (structures.layers[n] == layer)
        structures.planes[n].read_slice(
            static_cast<int>(k), [&](std::size_t v) { take(v, structures.declared[n].segment.number); });
    return {};
  };
  return send_layers(structures.file.header, read_slice, sink);
}

bool read_structures_for(DicomLibrary& library, reader::ParentEnd& parent, const fs::path& named,
                         const GridGeometry& grid) {
  const auto structures = inspect_structures(library, named, grid, sign_of_life(parent));
  return read_labels_for(parent, named, structures,
                         [&](VoxelSink& sink) { return send_structures(*structures, sink); });
}

bool read_segments_for(DicomLibrary& library, reader::ParentEnd& parent, const std::vector<fs::path>& files,
                       const fs::path& named) {
  const auto segments = inspect_segments(library, files, named, sign_of_life(parent));
  return read_labels_for(parent, named, segments,
                         [&](VoxelSink& sink) { return send_segments(library, *segments, sink); });
}

bool read_dicom_for(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found,
                    const fs::path& named, std::optional<int> number) {
  const auto content = find_content(library, parent, found);
  if (!content) return send_end(parent, content.error());
  const auto chosen = choose_volume(content->volumes, number);
  if (!chosen) return send_end(parent, chosen.error());
  if (!send_end(parent, {})) return false;
  const DicomVolume& volume = content->volumes[*chosen];
  std::vector<std::string> declared = content->notes;
  declared.insert(declared.end(), volume.notes.begin(), volume.notes.end());
  const VolumeFile file = volume_of(volume, named, std::move(declared));
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

bool list_dicom_for(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found) {
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

// Matches a segmentation with the images on which it may have been made: sends the number of the volume and
// the notes.
bool match_dicom_for(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found,
                     const fs::path& segmentation, const std::vector<fs::path>& files, bool one_series,
                     std::optional<int> number) {
  const auto content = find_content(library, parent, found);
  if (!content) return send_end(parent, content.error());
  const auto refused = [&](Error error, const fs::path& file) {
    error.where = file.string();
    return send_end(parent, error);
  };
  DicomReference reference;
  std::set<std::string> series;
  for (const fs::path& file : files) {
    const auto opened = InputFile::open(file);
    if (!opened) return send_end(parent, opened.error());
    const auto one = library.read_reference(opened->name_for_libraries());
    if (!one) return refused(one.error(), file);
    series.insert(one->own_series);
    reference.series.insert(one->series.begin(), one->series.end());
    reference.images.insert(one->images.begin(), one->images.end());
    reference.frames_of_reference.insert(one->frames_of_reference.begin(), one->frames_of_reference.end());
  }
  if (one_series && series.size() > 1)
    return refused(bad_input("",
                             "holds " + std::to_string(files.size()) + " segmentations of " +
                                 std::to_string(series.size()) + " series, which may be different readings",
                             "give one of them after the images, or this folder to read all of them as one"),
                   segmentation);
  const auto chosen = choose_segmented(
      content->volumes, relations_of(reference, content->volumes, content->identifiers), number);
  if (!chosen) return refused(chosen.error(), segmentation);
  if (!send_end(parent, {})) return false;
  reader::Sender out(parent);
  out.put(static_cast<std::uint32_t>(chosen->index + 1));
  out.put(static_cast<std::uint32_t>(chosen->is_declared));
  out.put(static_cast<std::uint32_t>(chosen->notes.size()));
  for (const std::string& note : chosen->notes) out.put(note);
  return out.ok();
}

// ---- in the parent process ----------------------------------------------------------------------

// DICOM library with its dictionary, before a reader process is started
Result<DicomLibrary*> ready_library() {
  const ItkSection section;
  auto library = load_dicom_files();
  if (!library) return library.error();
  if (auto loaded = (*library)->load_dictionary(); !loaded) return loaded.error();
  return *library;
}

// starts a reader process that may open the roots and their contents
Result<std::unique_ptr<reader::ReaderProcess>> start_in(const FoundFiles& found, std::size_t shared_bytes,
                                                        const Progress& progress,
                                                        const reader::ReaderProcess::Work& work) {
  std::vector<int> descriptors;
  for (const fs::path& root : found.roots)
    if (const int descriptor = ::open(root.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK); descriptor >= 0)
      descriptors.push_back(descriptor);
  auto process = start_reader(descriptors, shared_bytes, progress, work);
  for (const int descriptor : descriptors) ::close(descriptor);
  return process;
}

// waits until all files have been read
Result<void> wait_for_files(reader::ReaderProcess& process, const FoundFiles& found, Files named,
                            const Progress& progress) {
  std::size_t begun = 0;
  while (true) {
    std::uint32_t number = 0;
    if (auto declared = process.read(std::as_writable_bytes(std::span(&number, 1))); !declared) {
      // the file being read can only be identified by its path
      if (begun < found.files.size() && found.files.size() > 1) {
        Error error = about(declared.error(), {&found.files[begun], 1});
        if (error.kind == ErrorKind::kBadInput) error.remedy += ", or take it out of the folder";
        return error;
      }
      return about(declared.error(), named);
    }
    if (number == kEnd) return receive_end(process, named);
    begun = std::min<std::size_t>(number, found.files.size());
    progress.report("searching for volumes",
                    static_cast<double>(begun) / static_cast<double>(found.files.size()));
  }
}

Error at(const fs::path& file, const Error& error) {
  return {error.kind, error.what, file.string(), error.remedy};
}

constexpr std::size_t kMaxParts = 16, kMaxPart = 255;

// Path of a file that a DICOMDIR references; nullopt if it would leave the folder.
std::optional<fs::path> path_of_part(const fs::path& folder, const std::vector<std::string>& parts,
                                     bool lower) {
  fs::path directory = folder;
  if (parts.empty() || parts.size() > kMaxParts) return std::nullopt;
  for (const std::string& part : parts) {
    if (part.empty() || part.size() > kMaxPart || part == "." || part == ".." ||
        part.find('/') != std::string::npos || part.find('\\') != std::string::npos ||
        part.find('\0') != std::string::npos)
      return std::nullopt;
    directory /= lower ? lower_case(part) : part;
  }
  return directory;
}

Result<FoundFiles> files_named_by(const fs::path& directory, const Progress& progress) {
  const auto library = ready_library();
  if (!library) return at(directory, library.error());
  FoundFiles itself;
  itself.roots = itself.files = {directory};
  auto process = start_in(itself, 0, progress, [&](reader::ParentEnd& parent) {
    (*library)->begin_reading();
    const auto opened = InputFile::open(directory);
    if (!opened) return send_end(parent, opened.error());
    const auto files = (*library)->read_directory(opened->name_for_libraries());
    if (!files) return send_end(parent, files.error());
    if (!send_end(parent, {})) return false;
    reader::Sender out(parent);
    out.put(static_cast<std::uint32_t>(std::min(files->size(), kMaxDicomFiles)));
    for (const auto& parts : std::span(*files).first(std::min(files->size(), kMaxDicomFiles))) {
      out.put(static_cast<std::uint32_t>(std::min(parts.size(), kMaxParts + 1)));
      for (const std::string& part : std::span(parts).first(std::min(parts.size(), kMaxParts + 1)))
        out.put(part.substr(0, kMaxPart + 1));
    }
    return out.ok();
  });
  if (!process) return at(directory, process.error());
  const Files named{&directory, 1};
  if (auto result = wait_for_files(**process, itself, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxDicomFiles) return nonsense(named);

  FoundFiles found;
  const fs::path folder = directory.parent_path().empty() ? fs::path(".") : directory.parent_path();
  found.roots = {directory, folder};
  std::size_t missing = 0;
  std::set<fs::path> files;
  for (std::uint32_t n = 0; n < count && in.ok(); ++n) {
    if (progress.stopped()) return Progress::interrupted();
    std::uint32_t length = 0;
    in.get(length);
    if (length > kMaxParts + 1) return nonsense(named);
    std::vector<std::string> parts(length);
    for (std::string& part : parts) in.get(part, kMaxPart + 1);
    if (!in.ok()) break;
    auto target_path = path_of_part(folder, parts, false);
    if (!target_path)
      return bad_input(directory.string(),
                       "names a file that is not in its folder (ReferencedFileID (0004,1500))",
                       "give its folder: all DICOM files in it are found without the DICOMDIR");
    // some discs are mounted with lower-case names
    std::error_code ignored;
    if (!fs::is_regular_file(*target_path, ignored)) target_path = path_of_part(folder, parts, true);
    if (!fs::is_regular_file(*target_path, ignored)) {
      ++missing;
      continue;
    }
    if (auto stays = check_stays_in(folder, *target_path); !stays) return stays.error();
    files.insert(*target_path);
  }
  if (!in.ok()) return about(in.error(), named);
  found.files.assign(files.begin(), files.end());
  if (missing > 0)
    found.notes.push_back("names " + counted(missing, "file that is", "files that are") + " not there");
  if (found.files.empty())
    return bad_input(directory.string(),
                     "names " + counted(missing, "file that is", "files that are") + " not there",
                     "copy it together with the folders next to it");
  return found;
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

Result<DicomLibrary*> ready_dicom_library() {
  return ready_library();
}

Result<DicomIdentity> identity_of_study(const DicomAttachment& attached, const Progress& progress) {
  const fs::path& study = attached.study;
  const auto library = ready_library();
  if (!library) return at(study, library.error());
  if (!is_dicom(study))
    return bad_input(study.string(), "holds no DICOM image, so nothing can be attached to it",
                     "give the study: a DICOM folder or file");
  const auto found = find_files(study, progress);
  if (!found) return found.error();
  auto process = start_in(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return send_identity(**library, parent, *found, attached.volume);
  });
  if (!process) return at(study, process.error());
  const Files named{&study, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  DicomIdentity identity;
  std::uint32_t attributes = 0, images = 0;
  in.get(attributes);
  constexpr std::uint32_t kMaxAttributes = 100;
  if (attributes > kMaxAttributes) return nonsense(named);
  for (std::uint32_t n = 0; n < attributes && in.ok(); ++n) {
    auto& [tag, value] = identity.attributes.emplace_back();
    in.get(tag.first);
    in.get(tag.second);
    in.get(value);
  }
  std::string sop_class;
  for (std::string* text : {&identity.frame_of_reference, &identity.series, &sop_class}) in.get(*text);
  in.get(images);
  if (images > kMaxDicomFiles) return nonsense(named);
  for (std::uint32_t n = 0; n < images && in.ok(); ++n) {
    identity.images.emplace_back(sop_class, "");
    in.get(identity.images.back().second);
  }
  if (!in.ok()) return about(in.error(), named);
  return identity;
}

Result<DicomReader> open_dicom(const fs::path& file, std::optional<int> number, const Progress& progress) {
  const auto library = ready_library();
  if (!library) return at(file, library.error());
  const auto found = find_files(file, progress);
  if (!found) return found.error();
  auto process = start_in(*found, kSlots * kSlotBytes, progress, [&](reader::ParentEnd& parent) {
    return read_dicom_for(**library, parent, *found, file, number);
  });
  if (!process) return at(file, process.error());
  const Files named{&file, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  auto answer = receive_answer(**process, named);
  if (!answer) return answer.error();
  auto* volume = std::get_if<VolumeFile>(&*answer);
  if (!volume || volume->voxels.encoding != Encoding::kSlices) return nonsense(named);
  return DicomReader{*std::move(process), std::move(*volume)};
}

namespace {

std::optional<FileKind> kind_of_file(const fs::path& file) {
  std::error_code ignored;
  return fs::is_regular_file(file, ignored) ? dicom_kind_of(file, front_of(file)) : std::nullopt;
}

// Reads labels of one file, or of several files of a folder, by work(library, the process's end, files).
template <class Work>
Result<DicomReader> open_dicom_labels(const fs::path& file, std::vector<fs::path> files,
                                      const Progress& progress, const Work& work) {
  const auto library = ready_library();
  if (!library) return at(file, library.error());
  FoundFiles found;
  found.roots = {file};
  found.files = std::move(files);
  auto process = start_in(found, kSlots * kSlotBytes, progress,
                          [&](reader::ParentEnd& parent) { return work(**library, parent, found.files); });
  if (!process) return at(file, process.error());
  const Files named{&file, 1};
  // an unexpected end of the process concerns all of the files
  FoundFiles all;
  all.files = {file};
  std::vector<fs::path> blamed{file};
  blamed.insert(blamed.end(), found.files.begin(), found.files.end());
  if (auto result = wait_for_files(**process, all, blamed, progress); !result) return result.error();
  auto answer = receive_answer(**process, named);
  if (!answer) return answer.error();
  auto* volume = std::get_if<VolumeFile>(&*answer);
  if (!volume || volume->voxels.encoding != Encoding::kSlices) return nonsense(named);
  return DicomReader{*std::move(process), std::move(*volume)};
}

}  // namespace

std::vector<fs::path> dicom_segmentation_files(const fs::path& file) {
  const auto is_segmentation = [](const fs::path& one) {
    const auto kind = kind_of_file(one);
    return kind && kind->dicom_segmentation;
  };
  std::error_code ignored;
  if (!fs::is_directory(file, ignored))
    return is_segmentation(file) ? std::vector<fs::path>{file} : std::vector<fs::path>{};
  std::vector<fs::path> files;
  bool images = false;
  std::size_t inspected = 0;
  walk(file, [&](const fs::path& inside) {
    images = is_dicom_image(inside);
    if (is_segmentation(inside)) files.push_back(inside);
    return images || ++inspected == kMaxDicomFiles;
  });
  if (images) return {};
  std::ranges::sort(files);
  return files;
}

bool is_dicom_structures(const fs::path& file) {
  const auto kind = kind_of_file(file);
  return kind && kind->dicom_structures;
}

Result<DicomReader> open_dicom_segmentation(const fs::path& file, const Progress& progress) {
  std::vector<fs::path> files = dicom_segmentation_files(file);
  if (files.size() > kMaxSegmentationFiles)
    return bad_input(file.string(),
                     "holds " + std::to_string(files.size()) + " DICOM segmentations, and " +
                         std::to_string(kMaxSegmentationFiles) + " can be read together at most",
                     "give one of them, or put the ones to read into a separate folder");
  return open_dicom_labels(
      file, std::move(files), progress,
      [&](DicomLibrary& library, reader::ParentEnd& parent, const std::vector<fs::path>& parts) {
        return read_segments_for(library, parent, parts, file);
      });
}

Result<DicomReader> open_dicom_structures(const fs::path& file, const GridGeometry& grid,
                                          const Progress& progress) {
  auto reader =
      open_dicom_labels(file, {file}, progress,
                        [&](DicomLibrary& library, reader::ParentEnd& parent, const std::vector<fs::path>&) {
                          return read_structures_for(library, parent, file, grid);
                        });
  const Files named{&file, 1};
  if (reader && !reader->volume.header.geometry.same_grid(grid)) return nonsense(named);
  return reader;
}

}  // namespace palpate::volume_io

namespace palpate {

using namespace volume_io;

bool is_dicom(const std::filesystem::path& file) {
  std::error_code ignored;
  if (fs::is_regular_file(file, ignored)) return is_dicom_image(file) || is_dicom_directory(file);
  if (!fs::is_directory(file, ignored)) return false;
  std::size_t inspected = 0;
  bool found = false;
  walk(file, [&](const fs::path& inside) {
    found = is_dicom_image(inside);
    return found || ++inspected == kMaxDicomFiles;
  });
  return found;
}

bool is_structure_set(const std::filesystem::path& file) {
  return is_dicom_structures(file);
}

namespace {

bool is_dicom_labels(const fs::path& file) {
  const auto kind = kind_of_file(file);
  return kind && (kind->dicom_segmentation || kind->dicom_structures);
}

// label files of a named path: the file itself, or a folder of segmentations
std::vector<fs::path> label_files(const fs::path& named) {
  if (is_dicom_labels(named)) return {named};
  return dicom_segmentation_files(named);
}

// segmentations below a folder, ordered by name
Result<std::vector<fs::path>> segmentations_in(const fs::path& folder, const Progress& progress) {
  auto found = find_files(folder, progress);
  if (!found) return found.error();
  std::erase_if(found->files, [](const fs::path& file) { return !is_dicom_labels(file); });
  return std::move(found->files);
}

// deepest folder that contains all files
fs::path common_folder(const std::vector<fs::path>& files) {
  fs::path folder = files.front().parent_path();
  for (const fs::path& file : files) {
    const auto is_below = [&] { return !file.lexically_relative(folder).string().starts_with(".."); };
    while (folder.has_relative_path() && !is_below()) folder = folder.parent_path();
  }
  return folder;
}

// @param one_series  segmentations of several series are an error
Result<Study> matched(Study study, bool one_series, const Progress& progress) {
  const auto library = ready_library();
  if (!library) return at(study.scan, library.error());
  auto found = find_files(study.scan, progress);
  if (!found) return found.error();
  found->roots.push_back(*study.labels);
  const std::vector<fs::path> files = label_files(*study.labels);
  auto process = start_in(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return match_dicom_for(**library, parent, *found, *study.labels, files, one_series, study.volume);
  });
  if (!process) return at(study.scan, process.error());
  std::vector<fs::path> named{study.scan, *study.labels};
  named.insert(named.end(), files.begin(), files.end());
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  std::uint32_t number = 0, is_declared = 0, notes = 0;
  in.get(number);
  in.get(is_declared);
  in.get(notes);
  constexpr std::uint32_t kMaxNumber = 100'000, kMaxStudyNotes = 10;
  if (number < 1 || number > kMaxNumber || notes > kMaxStudyNotes) return nonsense(named);
  for (std::uint32_t n = 0; n < notes && in.ok(); ++n) {
    in.get(study.notes.emplace_back());
    study.notes.back() = study.labels->string() + " " + study.notes.back();
  }
  if (!in.ok()) return about(in.error(), named);
  study.volume = static_cast<int>(number);
  study.is_declared = is_declared == 1;
  return study;
}

}  // namespace

Result<Study> find_study(const std::filesystem::path& scan,
                         const std::optional<std::filesystem::path>& labels, std::optional<int> volume,
                         const Progress& progress) try {
  Study study{.scan = scan, .volume = volume, .labels = labels, .notes = {}};
  std::error_code ignored;
  const bool images = is_dicom(scan);
  if (!labels) {
    if (!images || !(std::filesystem::is_directory(scan, ignored) || is_dicom_directory(scan))) return study;
    const auto segmentations = segmentations_in(scan, progress);
    if (!segmentations) return segmentations.error();
    if (segmentations->empty()) return study;
    if (segmentations->size() > 1) {
      std::string list;
      constexpr std::size_t kListed = 10;
      for (std::size_t n = 0; n < std::min(segmentations->size(), kListed); ++n)
        list += (n ? ", " : " ") + (*segmentations)[n].string();
      if (segmentations->size() > kListed) list += ", ...";
      // a segmentation that is spread over several files is a folder per series
      const fs::path folder = common_folder(*segmentations);
      if (dicom_segmentation_files(folder).size() != segmentations->size())
        return Error{
            ErrorKind::kUsage,
            "holds " + std::to_string(segmentations->size()) +
                " segmentations in addition to its images:" + list,
            scan.string(),
            "give one of them after the folder; or put the files of one segmentation into a separate folder "
            "and give that; or give the images alone with --scan: palpate scene new"};
      study.labels = folder;
    } else {
      study.labels = segmentations->front();
    }
  }
  if (label_files(*study.labels).empty()) return study;
  if (images) return matched(std::move(study), !labels, progress);
  study.is_declared = false;
  study.notes.push_back(study.labels->string() + " states the images it was made on, but " + scan.string() +
                        " does not identify itself: whether they belong together was not checked");
  return study;
} catch (const std::bad_alloc&) {
  return bad_input(scan.string(), "does not fit into the memory",
                   "close other programs, or choose a smaller folder");
}

Result<VolumeList> list_volumes(const std::filesystem::path& file, const Progress& progress) try {
  PALPATE_CHECK(is_dicom(file));
  const auto library = ready_library();
  if (!library) return at(file, library.error());
  const auto found = find_files(file, progress);
  if (!found) return found.error();
  auto process = start_in(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return list_dicom_for(**library, parent, *found);
  });
  if (!process) return at(file, process.error());
  const Files named{&file, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  VolumeList list;
  std::uint32_t count = 0;
  in.get(count);
  if (count > kMaxListed) return nonsense(named);
  for (std::uint32_t n = 0; n < count && in.ok(); ++n) {
    auto& volume = list.volumes.emplace_back();
    in.get(volume.what);
    in.get(volume.fault);
    in.get(volume.remedy);
  }
  std::uint32_t notes = 0;
  in.get(notes);
  if (notes > kMaxListed) return nonsense(named);
  for (std::uint32_t n = 0; n < notes && in.ok(); ++n) in.get(list.notes.emplace_back());
  if (!in.ok()) return about(in.error(), named);
  return list;
} catch (const std::bad_alloc&) {
  return bad_input(file.string(), "does not fit into the memory",
                   "close other programs, or choose a smaller folder");
}

std::string in_words(IdentifierKind kind) {
  constexpr const char* kWords[kIdentifierKinds] = {
      "names of persons",        "numbers and addresses", "characteristics of the patient",
      "dates and times",         "unique identifiers",    "free text",
      "institution and station", "private elements",      "in or over the image"};
  return kWords[static_cast<std::size_t>(kind)];
}

namespace {

constexpr std::size_t kMaxRows = 10'000;

// Identifiers of all files by kind and element, sorted by tag, which follows the keyword in `what`.
struct IdentifierRows {
  using Key = std::tuple<IdentifierKind, std::string, std::string>;
  static Key key_of(const DicomIdentifier& one) {
    const auto tag = std::min(one.what.rfind('('), one.what.size());
    return {one.kind, one.what.substr(tag), one.what};
  }
  std::map<Key, IdentifierRow> rows;
  std::map<Key, std::set<std::string>> values;
  std::set<std::string> beyond;  // elements beyond kMaxRows, at most as many again
  std::size_t files = 0, burnt_in_unsaid = 0, unread = 0;
};

bool says_nothing_is_burnt_in(const DicomIdentifier& identifier) {
  return identifier.what.starts_with("BurnedInAnnotation") && identifier.value == "NO";
}

void put_identifiers(const std::vector<DicomIdentifier>& found, bool picture_declared, IdentifierRows& all) {
  ++all.files;
  all.burnt_in_unsaid += !picture_declared;
  std::set<IdentifierRows::Key> in_file;
  for (const DicomIdentifier& one : found) {
    if (says_nothing_is_burnt_in(one)) continue;
    const auto key = IdentifierRows::key_of(one);
    if (all.rows.size() == kMaxRows && !all.rows.contains(key)) {
      if (all.beyond.size() < kMaxRows) all.beyond.insert(one.what);
      continue;
    }
    IdentifierRow& row = all.rows[key];
    row.kind = one.kind;
    row.what = one.what;
    row.files += in_file.insert(key).second;
    auto& values = all.values[key];
    if (values.size() < kMaxIdentifierValues) values.insert(one.value);
    if (row.example.empty()) row.example = one.value;
  }
}

bool send_identifiers(DicomLibrary& library, reader::ParentEnd& parent, const FoundFiles& found) {
  library.begin_reading();
  IdentifierRows all;
  for (std::size_t n = 0; n < found.files.size(); ++n) {
    const auto begun = static_cast<std::uint32_t>(n);
    if (!parent.write(std::as_bytes(std::span(&begun, 1)))) return false;
    const fs::path& file = found.files[n];
    const auto kind = dicom_kind_of(file, front_of(file));
    if (!kind) continue;
    const auto opened = InputFile::open(file);
    const auto identifiers = opened ? library.read_identifiers(opened->name_for_libraries())
                                    : Result<std::vector<DicomIdentifier>>(opened.error());
    if (!identifiers) {
      ++all.unread;
      continue;
    }
    const bool image = kind->dicom_image;
    bool declared = !image;
    for (const DicomIdentifier& one : *identifiers)
      declared = declared || one.what.starts_with("BurnedInAnnotation");
    put_identifiers(*identifiers, declared, all);
  }
  if (!send_end(parent, {})) return false;
  reader::Sender out(parent);
  for (const std::size_t number :
       {all.files, all.burnt_in_unsaid, all.unread, all.beyond.size(), all.rows.size()})
    out.put(static_cast<std::uint32_t>(number));
  for (const auto& [key, row] : all.rows) {
    out.put(static_cast<std::uint8_t>(row.kind));
    out.put(row.what);
    out.put(static_cast<std::uint32_t>(row.files));
    out.put(static_cast<std::uint32_t>(all.values[key].size()));
    out.put(row.example);
  }
  return out.ok();
}

}  // namespace

Result<IdentifierReport> find_identifiers(const std::filesystem::path& file, bool values,
                                          const Progress& progress) try {
  const auto library = ready_library();
  if (!library) return at(file, library.error());
  auto found = find_files(file, progress);
  if (!found) return found.error();
  // the DICOMDIR itself contains a record of each patient
  if (is_dicom_directory(file)) found->files.push_back(file);
  auto process = start_in(*found, 0, progress, [&](reader::ParentEnd& parent) {
    return send_identifiers(**library, parent, *found);
  });
  if (!process) return at(file, process.error());
  const Files named{&file, 1};
  if (auto result = wait_for_files(**process, *found, named, progress); !result) return result.error();
  reader::Receiver in(**process, "is damaged: ");
  std::uint32_t files = 0, unsaid = 0, unread = 0, beyond = 0, rows = 0;
  for (std::uint32_t* number : {&files, &unsaid, &unread, &beyond, &rows}) in.get(*number);
  if (rows > kMaxRows) return nonsense(named);
  IdentifierReport report;
  report.files = files;
  report.burnt_in_unsaid = unsaid;
  for (std::uint32_t n = 0; n < rows && in.ok(); ++n) {
    IdentifierRow& row = report.rows.emplace_back();
    std::uint8_t kind = 0;
    std::uint32_t in_files = 0, different = 0;
    in.get(kind);
    in.get(row.what);
    in.get(in_files);
    in.get(different);
    in.get(row.example);
    if (kind >= kIdentifierKinds) return nonsense(named);
    row.kind = static_cast<IdentifierKind>(kind);
    row.files = in_files;
    row.different = different;
    if (!values) row.example.clear();
  }
  if (!in.ok()) return about(in.error(), named);
  report.notes = found->notes;
  if (unread > 0) report.notes.push_back(counted(unread, "DICOM file", "DICOM files") + " could not be read");
  if (beyond > 0)
    report.notes.push_back("has " + std::to_string(beyond) + (beyond == kMaxRows ? " or more" : "") +
                           " further elements, which are not listed");
  if (files == 0)
    return bad_input(file.string(), "holds no DICOM file that can be read",
                     "palpate ignores data other than voxels in other formats: docs/reference/formats.md");
  return report;
} catch (const std::bad_alloc&) {
  return bad_input(file.string(), "does not fit into the memory",
                   "close other programs, or choose a smaller folder");
}

}  // namespace palpate
