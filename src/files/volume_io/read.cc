#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <set>

#include "palpate/base/reading.h"
#include "volume_io/content.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/label_names.h"
#include "volume_io/labels/label_sink.h"
#include "volume_io/labels/label_table.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/labels/masks.h"
#include "volume_io/labels/segment_fields.h"
#include "volume_io/mesh/meshes.h"
#include "volume_io/read_options.h"
#include "volume_io/value_statistics.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_cache.h"
#include "volume_io/voxel_stream.h"

namespace palpate {

using namespace volume_io;

namespace {

// Replaces NaN and infinity by the lowest value of the scan; false if no value is finite.
bool replace_non_finite(std::vector<float>& voxels, std::size_t& replaced) {
  float lowest = std::numeric_limits<float>::infinity();
  replaced = 0;
  for (const float v : voxels) {
    if (std::isfinite(v))
      lowest = std::min(lowest, v);
    else
      ++replaced;
  }
  if (replaced == voxels.size()) return false;
  if (replaced == 0) return true;
  for (float& v : voxels)
    if (!std::isfinite(v)) v = lowest;
  return true;
}

// segments declared in the file, and an unnamed one for every other value in the voxels
Result<std::vector<Segment>> find_segments(const VolumeFile& file, const LabelSink& sink) {
  auto declared = parse_segment_fields(file.segment_fields, file.header.layers, file.voxels.file.string());
  if (!declared) return declared.error();
  std::vector<Segment> segments = std::move(*declared);
  // a label table names all possible structures, a segmentation those present
  if (file.header.format == "NIfTI")
    std::erase_if(segments, [&](const Segment& s) {
      return !sink.present(static_cast<std::size_t>(s.layer), s.value);
    });
  std::set<std::pair<int, LabelId>> known;
  for (const Segment& s : segments) known.emplace(s.layer, s.value);
  for (int layer = 0; layer < file.header.layers && segments.size() < kLabelValues; ++layer)
    for (std::size_t v = 1; v < kLabelValues; ++v) {
      const auto value = static_cast<LabelId>(v);
      if (sink.present(static_cast<std::size_t>(layer), value) && !known.contains({layer, value}))
        segments.push_back({0, "", colour_for(value), layer, value});
    }
  if (segments.size() >= kLabelValues || !number_segments(segments))
    return bad_input(file.voxels.file.string(), "has more segments than label numbers");
  return segments;
}

// finite values of a scan
struct ScanValues {
  std::vector<float> voxels;
  std::uint64_t replaced = 0;
};

Result<ScanValues> unpack_scan(VolumeReader& reader, const std::filesystem::path& path) {
  const VolumeFile& file = reader.file();
  ScanValues values{unfilled<float>(file.header.geometry)};
  std::vector<float>& voxels = values.voxels;
  const VoxelSource& source = file.voxels;
  const bool scaled = is_scaled(source);
  const auto read = reader.stream([&](std::uint64_t first, std::span<const std::byte> bytes) {
    with_type(source.component, [&](auto type) {
      using T = decltype(type);
      grow_to(voxels, first + bytes.size() / sizeof(T));
      for_each_value<T>(first, bytes, [&](std::uint64_t n, T stored) {
        voxels[static_cast<std::size_t>(n)] =
            scaled ? static_cast<float>(source.slope * static_cast<double>(stored) + source.intercept)
                   : static_cast<float>(stored);
      });
    });
    return Result<void>();
  });
  if (!read) return read.error();
  std::size_t replaced = 0;
  if (!replace_non_finite(voxels, replaced)) return bad_input(path.string(), "holds no finite number");
  values.replaced = replaced;
  return values;
}

Result<ScanFile> take_scan(VolumeReader& reader, const std::filesystem::path& path, const Progress& progress,
                           const Warn& warn, VoxelCaching caching) {
  const VolumeFile& file = reader.file();
  if (file.header.layers > 1)
    return bad_input(path.string(), "holds several values for each voxel, but a scan has one",
                     "if it is a segmentation give it as the labels");
  if (auto plausible = check_plausible(file, sizeof(float)); !plausible) return plausible.error();

  const VoxelCacheEntry cache_entry(reader, "scan", caching);
  ScanValues values;
  if (cache_entry.find_scan(values.voxels, values.replaced)) {
    progress.report("loading from the cache", 0);
  } else {
    auto fresh = unpack_scan(reader, path);
    if (!fresh) return fresh.error();
    values = *std::move(fresh);
    cache_entry.store_scan(values.voxels, values.replaced);
  }
  if (values.replaced > 0 && warn)
    warn(path.string() + ": " + std::to_string(values.replaced) +
         (file.padded ? " voxels are padding outside the scanned region (PixelPaddingValue (0028,0120))"
                      : " voxels are not numbers (NaN or infinite)") +
         "; they are set to the lowest value of the scan");
  for (const std::string& note : file.notes)
    if (warn) warn(path.string() + ": " + note);
  return ScanFile{file.header, Volume<float>(file.header.geometry, std::move(values.voxels))};
}

// informs a user who expects the file name as structure name why it is not used, and how to set it
std::string left_out_of_name(const std::string& name) {
  const std::string used =
      name.empty()
          ? "its structure has no name, because the name of its file has no known anatomical word"
          : "its structure is called \"" + name + "\", the known anatomical words of its file's name";
  return used +
         "; other words might identify a patient\n"
         "  a table can set any name (--names TABLE, or a table next to it with the same name)";
}

Result<LabelFile> take_labels(VolumeReader& reader, const std::filesystem::path& path,
                              const std::optional<std::filesystem::path>& names,
                              const std::optional<std::filesystem::path>& scan, const Progress& progress,
                              const Warn& warn, AmbiguousLabels ambiguous, VoxelCaching caching) {
  const VolumeFile& file = reader.file();
  const auto found = find_names(file, path, names, scan, warn);
  if (!found) return found.error();
  const auto layers = static_cast<std::uint64_t>(file.header.layers);
  if (auto plausible = check_plausible(file, sizeof(LabelId), layers * kLabelValues); !plausible)
    return plausible.error();

  LabelSink sink(file);
  const VoxelCacheEntry cache_entry(reader, "labels", caching);
  if (sink.load(cache_entry)) {
    progress.report("loading from the cache", 0);
  } else {
    const auto read = reader.stream([&](std::uint64_t first, std::span<const std::byte> bytes) {
      return with_type(file.voxels.component,
                       [&](auto type) { return sink.take<decltype(type)>(first, bytes); });
    });
    if (!read) return read.error();
    if (const auto checked = sink.check_ids(); !checked) return checked.error();
    sink.store(cache_entry);
  }
  for (const std::string& note : file.notes)
    if (warn) warn(path.string() + ": " + note);

  auto segments = find_segments(file, sink);
  if (!segments) return segments.error();
  const auto belongs = check_belongs(*found, *segments, file.header.format == kColouredPictures, path, warn);
  if (!belongs) return belongs.error();
  if (*belongs) apply_names(found->names, file.header.format == kColouredPictures, *segments);
  std::error_code unknown;
  NameSource source = *belongs                                       ? found->source
                      : !file.header.has_segments                    ? NameSource::kNone
                      : std::filesystem::is_directory(path, unknown) ? NameSource::kFileName
                                                                     : NameSource::kFile;
  // a mask of one structure is named by its file
  if (segments->size() == 1 && segments->front().name.empty()) {
    const AnatomyInName own = name_of_mask(path);
    segments->front().name = own.name;
    if (!own.name.empty()) source = NameSource::kFileName;
    if (own.left_out && warn) warn(path.string() + ": " + left_out_of_name(own.name));
  }
  LabelFile result{file.header, {sink.take_layers(), std::move(*segments)}, {}, source};
  if (*belongs) result.names_table = found->table;
  for (const Segment& s : result.labels.segments)
    if (s.name.empty()) result.unnamed.push_back(s.id);
  if (is_declared_as_labels(result) || !resembles_scan(result.labels)) return result;
  const Error error = looks_like_scan(path, result.labels.segments.size());
  if (ambiguous == AmbiguousLabels::kReject) return error;
  if (warn) warn(error.message());
  return result;
}

}  // namespace

Result<VolumeHeader> read_header(const std::filesystem::path& file, std::optional<int> volume) try {
  const Progress silent;
  const auto reader = VolumeReader::open(file, silent, volume, nullptr, with_process_defaults({}));
  if (!reader) return reader.error();
  return reader->file().header;
} catch (const std::bad_alloc&) {
  return out_of_memory(file);
}

Result<std::variant<ScanFile, LabelFile>> read_volume(const std::filesystem::path& file,
                                                      const std::optional<std::filesystem::path>& names,
                                                      const Progress& progress, const Warn& warn,
                                                      VoxelCaching caching, std::optional<int> volume) try {
  using Volumes = std::variant<ScanFile, LabelFile>;
  auto reader = VolumeReader::open(file, progress, volume, nullptr, with_process_defaults({}));
  if (!reader) return reader.error();
  const auto labels = [&](const std::string& evidence) -> Result<Volumes> {
    const AmbiguousLabels ambiguous =
        read_as() == ReadAs::kLabels ? AmbiguousLabels::kWarn : AmbiguousLabels::kReject;
    auto read = take_labels(*reader, file, names, {}, progress, warn, ambiguous, caching);
    if (!read) return read.error();
    read->evidence = evidence;
    return Volumes(*std::move(read));
  };
  const VolumeHeader& header = reader->file().header;
  if (read_as() == ReadAs::kLabels) return labels("");
  if (read_as() != ReadAs::kScan) {
    if (header.has_segments || header.layers > 1) return labels("it holds segments");
    if (header.meaning == ValueMeaning::kLabels) return labels("its header states it");
  }
  std::string evidence;
  {
    auto scan = take_scan(*reader, file, progress, warn, caching);
    if (!scan) return scan.error();
    const VolumeContent content = classify_content(*scan, file, names);
    if (content.kind == VolumeContent::Kind::kUnclear) return unclear_content(file, content.evidence);
    if (content.kind == VolumeContent::Kind::kScan) {
      scan->evidence = content.evidence;
      return Volumes(*std::move(scan));
    }
    evidence = content.evidence;
  }
  // the memory of the scan has been released
  return labels(evidence);
} catch (const std::bad_alloc&) {
  return out_of_memory(file);
}

Result<ScanFile> read_scan(const std::filesystem::path& file, const Progress& progress, const Warn& warn,
                           VoxelCaching caching, std::optional<int> volume,
                           const PlacementOptions& placement_options) try {
  if (!volume && !is_dicom(file)) {
    if (is_meshes(file))
      return bad_input(file.string(), "holds surfaces, which are labels, not a scan",
                       "give it as the labels, after the scan");
    if (is_masks(file)) {
      std::vector<std::string> names;
      for (const std::filesystem::path& one : volumes_in(file)) names.push_back(one.filename().string());
      return bad_input(file.string(), "holds several volumes, but a scan is one volume",
                       "give the scan in it: " + names_in_words(names) +
                           "; give a folder of masks as the labels, after the scan");
    }
  }
  auto reader = VolumeReader::open(file, progress, volume, nullptr, with_process_defaults(placement_options),
                                   ImageColours::kGrey);
  if (!reader) return reader.error();
  return take_scan(*reader, file, progress, warn, caching);
} catch (const std::bad_alloc&) {
  return out_of_memory(file);
}

Result<LabelFile> read_labels(const std::filesystem::path& file,
                              const std::optional<std::filesystem::path>& names, const Progress& progress,
                              const Warn& warn, AmbiguousLabels ambiguous, VoxelCaching caching,
                              const GridGeometry* scan_grid, const PlacementOptions& placement_options,
                              const std::optional<std::filesystem::path>& scan) try {
  if (is_dicom(file))
    return bad_input(file.string(), "holds DICOM images, which are a scan, not labels",
                     "give it as the scan, and a label map in addition");
  auto reader = VolumeReader::open(file, progress, {}, scan_grid, with_process_defaults(placement_options));
  if (!reader) return reader.error();
  return take_labels(*reader, file, names, scan, progress, warn, ambiguous, caching);
} catch (const std::bad_alloc&) {
  return out_of_memory(file);
}

}  // namespace palpate
