#include "volume_io/dicom/dicom_read_labels.h"

#include <algorithm>
#include <set>

#include "palpate/base/file.h"
#include "volume_io/dicom/dicom_segment_grid.h"
#include "volume_io/dicom/dicom_segment_names.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/structure_files.h"
#include "volume_io/volume_message.h"
#include "volume_io/voxel_stream.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

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
          if (value > 0 && 2 * value >= coding.max_fractional_value) take(v, segment);
          break;
        case SegmentCoding::Kind::kLabels:
          if (value != 0 && value != coding.background_value &&
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
  SegmentOverlapPairs overlaps;
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
    overlaps = *std::move(found);
  }
  const auto layers = assign_layers(segmentation.segments.size(), overlaps, segments.file);
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
  auto grid = segment_grid_of(segmentation);
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

bool serve_segments(DicomLibrary& library, reader::ParentEnd& parent, const std::vector<fs::path>& files,
                    const fs::path& named) {
  const auto segments = inspect_segments(library, files, named, sign_of_life(parent));
  return serve_labels(parent, named, segments,
                      [&](VoxelSink& sink) { return send_segments(library, *segments, sink); });
}

}  // namespace

Result<DicomReader> open_dicom_labels(const fs::path& file, std::vector<fs::path> files,
                                      const Progress& progress, const ServeLabels& serve) {
  const auto library = ready_dicom_library();
  if (!library) return at_file(file, library.error());
  FoundFiles found;
  found.roots = {file};
  found.files = std::move(files);
  auto process = start_dicom_reader(found, kSlots * kSlotBytes, progress, [&](reader::ParentEnd& parent) {
    return serve(**library, parent, found.files);
  });
  if (!process) return at_file(file, process.error());
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
  if (!volume || volume->voxels.encoding != Encoding::kSlices) return impossible_volume(named);
  return DicomReader{*std::move(process), std::move(*volume)};
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
        return serve_segments(library, parent, parts, file);
      });
}

}  // namespace palpate::volume_io
