#include <algorithm>
#include <cmath>
#include <limits>
#include <new>
#include <set>

#include "palpate/base/reading.h"
#include "volume_io/dicom.h"
#include "volume_io/formats.h"
#include "volume_io/label_names.h"
#include "volume_io/label_sink.h"
#include "volume_io/layered_labels.h"
#include "volume_io/masks.h"
#include "volume_io/meshes.h"
#include "volume_io/segment_fields.h"
#include "volume_io/value_statistics.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_cache.h"
#include "volume_io/voxel_stream.h"

namespace palpate {

using namespace volume_io;

namespace {

PlacementOptions& process_placement_options() {
  static PlacementOptions placement_options;
  return placement_options;
}

// settings of this read, completed by those of the process
PlacementOptions with_process_defaults(PlacementOptions placement_options) {
  const PlacementOptions& all = process_placement_options();
  if (!placement_options.mesh.space) placement_options.mesh.space = all.mesh.space;
  if (!placement_options.mesh.unit_mm) placement_options.mesh.unit_mm = all.mesh.unit_mm;
  if (!placement_options.image_spacing_mm) placement_options.image_spacing_mm = all.image_spacing_mm;
  if (!placement_options.nifti_form) placement_options.nifti_form = all.nifti_form;
  placement_options.scan_is_cropped = placement_options.scan_is_cropped || all.scan_is_cropped;
  return placement_options;
}

ReadAs& read_as_of_process() {
  static ReadAs kind = ReadAs::kByContent;
  return kind;
}

// Declared to be labels: by segments or the intent in the file, or by names for more than half of the labels.
bool is_declared_as_labels(const LabelFile& file) {
  return file.header.has_segments || file.header.meaning == ValueMeaning::kLabels ||
         2 * file.unnamed.size() < file.labels.segments.size();
}

Error looks_like_scan(const std::filesystem::path& file, std::size_t values) {
  return bad_input(file.string(),
                   "looks like a scan, not a label map: " + std::to_string(values) +
                       " values, which change from voxel to voxel",
                   "give it as the scan; if it is a label map, name its labels in a table (--names)");
}

Error unclear_content(const std::filesystem::path& file, const std::string& evidence) {
  return bad_input(file.string(), "may be a label map or a scan: " + evidence,
                   "choose one: --labels " + file.string() + ", or --scan " + file.string());
}

Error out_of_memory(const std::filesystem::path& file) {
  return bad_input(file.string(), "does not fit into the memory",
                   "close other programs, or crop the volume first");
}

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

// True if a row of a table names the segment.
// @param by_colour  labels are the colours of images, which have no numbers of their own
bool names_segment(const NamedLabel& named, const Segment& segment, bool by_colour) {
  return by_colour && named.colour ? segment.colour == *named.colour : segment.id == named.value;
}

// applies the names of a table, which override those of the file
void apply_names(const std::vector<NamedLabel>& names, bool by_colour, std::vector<Segment>& segments) {
  for (const NamedLabel& named : names)
    for (Segment& s : segments) {
      if (!names_segment(named, s, by_colour)) continue;
      s.name = named.name;
      if (named.colour) s.colour = *named.colour;
    }
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

struct FoundNames {
  std::vector<NamedLabel> names;
  NameSource source = NameSource::kNone;
  std::optional<std::filesystem::path> table = {};
  std::vector<std::filesystem::path> others = {};  // other volumes to which the table may belong
};

// table that may name the labels: a given one, or one in the folder of the file
Result<FoundNames> find_names(const VolumeFile& file, const std::filesystem::path& labels,
                              const std::optional<std::filesystem::path>& supplied,
                              const std::optional<std::filesystem::path>& scan, const Warn& warn) {
  if (supplied) {
    auto names = read_label_names(*supplied);
    if (!names) return names.error();
    return FoundNames{*std::move(names), NameSource::kSuppliedTable, supplied};
  }
  if (file.header.has_segments && file.header.format != kColouredPictures) return FoundNames{};
  const auto table = find_adjacent_table(labels, scan);
  if (!table) return FoundNames{};
  const auto stays = check_stays_in(labels.parent_path(), table->file);
  auto names = stays ? read_label_names(table->file) : stays.error();
  if (names)
    return FoundNames{*std::move(names), table->has_own_name ? NameSource::kOwnTable : NameSource::kOnlyTable,
                      table->file, table->others};
  // the user did not ask for this table, which may belong to something else
  if (warn && table->others.empty())
    warn(names.error().message() + "\n  the table was not used, the labels stay without names");
  return FoundNames{};
}

// Content according to the header, or otherwise to the first non-zero voxel values, and those values.
struct SampledContent {
  VolumeContent content;
  ValueStatistics values = {};  // empty if the header decides
};

Result<SampledContent> sample_content(const std::filesystem::path& file) {
  using Kind = VolumeContent::Kind;
  constexpr std::size_t kEnough = std::size_t{1} << 20;
  const Progress silent;
  auto reader = VolumeReader::open(file, silent, {}, nullptr, with_process_defaults({}));
  if (!reader) return reader.error();
  const VolumeFile& volume = reader->file();
  const VolumeHeader& header = volume.header;
  if (header.has_segments || header.layers > 1) return SampledContent{{Kind::kLabels, "it holds segments"}};
  if (header.meaning == ValueMeaning::kLabels) return SampledContent{{Kind::kLabels, "its header states it"}};
  if (header.meaning == ValueMeaning::kMeasured) return SampledContent{{Kind::kScan, "its header states it"}};
  std::vector<float> values;
  // truncated data are sufficient here
  (void)reader->stream([&](std::uint64_t first, std::span<const std::byte> bytes) -> Result<void> {
    with_type(volume.voxels.component, [&](auto type) {
      for_each_value<decltype(type)>(first, bytes, [&](std::uint64_t, auto stored) {
        const double value = volume.voxels.slope * static_cast<double>(stored) + volume.voxels.intercept;
        if (value != 0) values.push_back(static_cast<float>(value));
      });
    });
    if (values.size() >= kEnough) return bad_input(file.string(), "no more values are needed");
    return {};
  });
  ValueStatistics statistics = statistics_of(values);
  if (!statistics.only_whole && has_large_ids(values))
    return SampledContent{{Kind::kLabels, "its values are whole numbers in patches"}};
  VolumeContent content = content_by_values(statistics);
  return SampledContent{std::move(content), std::move(statistics)};
}

// whether a volume next to a table may be the label map of that table
bool may_be_labels(const std::filesystem::path& file) {
  const auto sampled = sample_content(file);
  return sampled.ok() && sampled->content.kind != VolumeContent::Kind::kScan;
}

template <class IsPresent>
std::size_t count_named(const std::vector<NamedLabel>& names, const IsPresent& is_present) {
  return static_cast<std::size_t>(std::ranges::count_if(
      names, [&](const NamedLabel& named) { return named.value != 0 && is_present(named.value); }));
}

// "1, 2, 3 and 7 more"
std::string some_of(const std::vector<LabelId>& values) {
  constexpr std::size_t kNamed = 3;
  std::string text;
  for (std::size_t n = 0; n < std::min(kNamed, values.size()); ++n)
    text += (n == 0 ? "" : ", ") + std::to_string(values[n]);
  if (values.size() > kNamed) text += " and " + std::to_string(values.size() - kNamed) + " more";
  return text;
}

// True if a table belongs to the label map. Warns about a table that is not used; a given table that names
// none of the labels is an error.
Result<bool> check_belongs(const FoundNames& found, const std::vector<Segment>& segments, bool by_colour,
                           const std::filesystem::path& labels, const Warn& warn) {
  if (!found.table || segments.empty()) return found.table.has_value();
  const auto named = static_cast<std::size_t>(std::ranges::count_if(found.names, [&](const NamedLabel& line) {
    return line.value != 0 && std::ranges::any_of(segments, [&](const Segment& segment) {
             return names_segment(line, segment, by_colour);
           });
  }));
  std::vector<LabelId> in_map, in_table;
  for (const Segment& segment : segments) in_map.push_back(segment.id);
  for (const NamedLabel& label : found.names)
    if (label.value != 0) in_table.push_back(label.value);
  const std::string table = found.table->string();
  const auto not_used = [&](const std::string& why) {
    if (warn)
      warn(table + " was not used for " + labels.string() + ": " + why + "; --names " + table + " uses it");
    return false;
  };
  if (named == 0) {
    const std::string why = "it names none of its labels, which are " + some_of(in_map) + ", but " +
                            (in_table.empty() ? std::string("0 alone") : some_of(in_table));
    if (found.source == NameSource::kSuppliedTable)
      return bad_input(table,
                       "names none of the labels of " + labels.string() + ", which are " + some_of(in_map) +
                           ", but " + (in_table.empty() ? std::string("0 alone") : some_of(in_table)),
                       "give the table of this label map");
    return not_used(why);
  }
  if (found.source != NameSource::kOnlyTable) return true;
  if (10 * named < 9 * segments.size())
    return not_used("it names " + std::to_string(named) + " of its " + std::to_string(segments.size()) +
                    " labels, and may belong to another map");
  const auto rival = std::ranges::find_if(found.others, may_be_labels);
  if (rival != found.others.end()) return not_used("it may also belong to " + rival->filename().string());
  return true;
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

// evidence, by a given table or one in the folder, that the values are labels
std::optional<std::string> evidence_by_table(const ValueStatistics& values, const std::filesystem::path& file,
                                             const std::optional<std::filesystem::path>& supplied) {
  if (!values.only_whole || values.distinct == 0) return std::nullopt;
  if (supplied) return "its values are whole numbers, and a table was given";
  const auto beside = find_adjacent_table(file, {});
  if (!beside || !check_stays_in(file.parent_path(), beside->file)) return std::nullopt;
  const auto names = read_label_names(beside->file);
  if (!names) return std::nullopt;
  const std::size_t named = count_named(*names, [&](LabelId value) { return values.is_present[value] != 0; });
  const bool belongs = beside->has_own_name ? 2 * named >= values.distinct
                                            : 10 * named >= 9 * values.distinct &&
                                                  std::ranges::none_of(beside->others, may_be_labels);
  if (!belongs) return std::nullopt;
  return beside->file.string() + " names " + std::to_string(named) + " of its " +
         std::to_string(values.distinct) + " values";
}

VolumeContent classify_content(const ScanFile& scan, const std::filesystem::path& file,
                               const std::optional<std::filesystem::path>& names) {
  using Kind = VolumeContent::Kind;
  if (read_as() == ReadAs::kScan) return {Kind::kScan, ""};
  if (scan.header.meaning == ValueMeaning::kMeasured && !names) return {Kind::kScan, "its header states it"};
  const ValueStatistics values = statistics_of(scan.scan.voxels());
  if (const auto evidence = evidence_by_table(values, file, names)) return {Kind::kLabels, *evidence};
  if (!values.only_whole && has_large_ids(scan.scan.voxels()))
    return {Kind::kLabels, "its values are whole numbers in patches"};
  return content_by_values(values);
}

// content of a file given to identify_scan_and_labels()
Result<VolumeContent> named_content(const std::filesystem::path& file,
                                    const std::optional<std::filesystem::path>& names) {
  using Kind = VolumeContent::Kind;
  if (is_dicom(file)) return VolumeContent{Kind::kScan, "it holds DICOM images"};
  if (is_meshes(file)) return VolumeContent{Kind::kLabels, "it holds surfaces"};
  if (is_masks(file)) return VolumeContent{Kind::kLabels, "it is a folder of masks"};
  if (is_structure_set(file)) return VolumeContent{Kind::kLabels, "it is a DICOM structure set"};
  if (!dicom_segmentation_files(file).empty())
    return VolumeContent{Kind::kLabels, "it is a DICOM segmentation"};
  if (auto other = describe_non_volume(file)) return *std::move(other);
  auto sampled = sample_content(file);
  if (!sampled) return sampled.error();
  if (sampled->content.kind != Kind::kLabels)
    if (const auto evidence = evidence_by_table(sampled->values, file, names))
      return VolumeContent{names ? Kind::kUnclear : Kind::kLabels, *evidence};
  return std::move(sampled->content);
}

}  // namespace

Result<ScanAndLabels> identify_scan_and_labels(const std::filesystem::path& first,
                                               const std::filesystem::path& second,
                                               const std::optional<std::filesystem::path>& names) try {
  using Kind = VolumeContent::Kind;
  std::error_code unknown;
  if (std::filesystem::equivalent(first, second, unknown))
    return Error{ErrorKind::kUsage, "the same file is given as the scan and as the label map", first.string(),
                 "give the label map alone, or its scan as well"};
  const auto a = named_content(first, names);
  if (!a) return a.error();
  const auto b = named_content(second, names);
  if (!b) return b.error();
  if (read_as() != ReadAs::kByContent) return ScanAndLabels{first, second};
  if (a->kind == b->kind && a->kind != Kind::kUnclear) {
    const bool scans = a->kind == Kind::kScan;
    return Error{
        ErrorKind::kBadInput,
        std::string(scans ? "two scans" : "two label maps") + ", but a scan and its segmentation " +
            "are needed: the first because " + a->evidence + ", the second because " + b->evidence,
        first.string() + " and " + second.string(),
        scans ? "give the segmentation of one of them; --labels reads " + second.string() + " as labels"
              : "give the scan of one of them; --scan reads " + first.string() + " as a scan"};
  }
  if (a->kind == Kind::kLabels || b->kind == Kind::kScan) return ScanAndLabels{second, first};
  return ScanAndLabels{first, second};
} catch (const std::bad_alloc&) {
  return out_of_memory(first);
}

void set_placement_options(const PlacementOptions& placement_options) {
  process_placement_options() = placement_options;
}

const PlacementOptions& placement_options() {
  return process_placement_options();
}

void set_read_as(ReadAs kind) {
  read_as_of_process() = kind;
}

ReadAs read_as() {
  return read_as_of_process();
}

std::string_view description_of(NameSource source) {
  switch (source) {
    case NameSource::kNone:
      return "nowhere";
    case NameSource::kFile:
      return "the file itself";
    case NameSource::kFileName:
      return "anatomical words in its file names";
    case NameSource::kSuppliedTable:
      return "the given table";
    case NameSource::kOwnTable:
      return "a table next to it with the same name";
    case NameSource::kOnlyTable:
      return "the only table next to it, which names its values";
  }
  return "";
}

std::string origin_of_names(const LabelFile& labels) {
  const std::size_t all = labels.labels.segments.size(), unnamed = labels.unnamed.size();
  const std::string many = std::to_string(all) + (all == 1 ? " label" : " labels");
  if (all == unnamed) return "no name for its " + many;
  return (unnamed == 0 ? many : std::to_string(all - unnamed) + " of " + many) +
         (all - unnamed == 1 ? " has its name from " : " have their names from ") +
         (labels.names_table ? labels.names_table->string() + ", " : "") +
         std::string(description_of(labels.name_source));
}

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
