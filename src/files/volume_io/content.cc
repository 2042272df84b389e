#include "volume_io/content.h"

#include <algorithm>
#include <new>
#include <vector>

#include "palpate/base/reading.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/label_table.h"
#include "volume_io/labels/masks.h"
#include "volume_io/mesh/meshes.h"
#include "volume_io/read_options.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_stream.h"
#include "volume_io/voxel_values.h"

namespace palpate {

using namespace volume_io;

namespace {

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

bool volume_io::may_be_labels(const std::filesystem::path& file) {
  const auto sampled = sample_content(file);
  return sampled.ok() && sampled->content.kind != VolumeContent::Kind::kScan;
}

bool volume_io::is_declared_as_labels(const LabelFile& file) {
  return file.header.has_segments || file.header.meaning == ValueMeaning::kLabels ||
         2 * file.unnamed.size() < file.labels.segments.size();
}

VolumeContent volume_io::classify_content(const ScanFile& scan, const std::filesystem::path& file,
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

Error volume_io::looks_like_scan(const std::filesystem::path& file, std::size_t values) {
  return bad_input(file.string(),
                   "looks like a scan, not a label map: " + std::to_string(values) +
                       " values, which change from voxel to voxel",
                   "give it as the scan; if it is a label map, name its labels in a table (--names)");
}

Error volume_io::unclear_content(const std::filesystem::path& file, const std::string& evidence) {
  return bad_input(file.string(), "may be a label map or a scan: " + evidence,
                   "choose one: --labels " + file.string() + ", or --scan " + file.string());
}

Error volume_io::out_of_memory(const std::filesystem::path& file) {
  return bad_input(file.string(), "does not fit into the memory",
                   "close other programs, or crop the volume first");
}

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

}  // namespace palpate
