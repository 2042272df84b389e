#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "palpate/base/child_process.h"
#include "palpate/base/reading.h"
#include "palpate/catalog/catalog.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/reader/reader_process.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/formats/formats.h"
#include "volume_io/labels/masks.h"
#include "volume_io/mesh/meshes.h"
#include "volume_io/streams/byte_stream.h"
#include "volume_io/streams/inflate.h"
#include "volume_io/volume_reader.h"
#include "volume_io/voxel_cache.h"
#include "volume_io/voxel_stream.h"

// Volumes in a page: the readers of NRRD, NIfTI and MetaImage, in this process. WebAssembly confines them as
// the reader process does on a computer: they reach the files that the page was given, and nothing else.
// Formats that need libraries are not read here.
namespace palpate {
namespace volume_io {
namespace {

// Estimate of the peak memory of a session per voxel of its label map. The shared knee of 24 million voxels
// takes 11.2 bytes per voxel (docs/decisions/0087-webassembly.md).
constexpr std::uint64_t kSession_bytes_per_voxel = 12;

constexpr const char* kOnAComputer =
    "open it with palpate installed on a computer, or save it as NRRD or NIfTI";

// voxels in all layers; GridGeometry::voxel_count() has 32 bits here, which a header may exceed
std::uint64_t count_values(const VolumeFile& volume) {
  const auto& dims = volume.header.geometry.dims;
  return static_cast<std::uint64_t>(dims[0]) * static_cast<std::uint64_t>(dims[1]) *
         static_cast<std::uint64_t>(dims[2]) * static_cast<std::uint64_t>(volume.header.layers);
}

// rejects a volume whose session would not fit into the page, before anything of it is read
Result<void> check_size(const VolumeFile& volume, const std::filesystem::path& file) {
  const auto layers = static_cast<std::uint64_t>(volume.header.layers);
  const std::uint64_t voxels = count_values(volume) / layers;
  const std::uint64_t needed = voxels * (kSession_bytes_per_voxel + sizeof(LabelId) * (layers - 1));
  if (check_memory(needed, "")) return {};
  const auto& dims = volume.header.geometry.dims;
  const auto mebibytes = [](std::uint64_t bytes) { return std::to_string(bytes >> 20) + " MiB"; };
  return bad_input(file.string(),
                   "has " + std::to_string(dims[0]) + " x " + std::to_string(dims[1]) + " x " +
                       std::to_string(dims[2]) + " = " + std::to_string(voxels) + " voxels" +
                       (layers > 1 ? " in " + std::to_string(layers) + " layers" : "") +
                       ", which take about " + mebibytes(needed) + ", but this page may take " +
                       mebibytes(reading_limits().max_memory_bytes),
                   "crop or resample it first, or open it with palpate installed on a computer");
}

class InflateStream final : public ByteStream {
 public:
  std::size_t read(std::span<std::byte> out) override {
    const std::size_t received = inflater_.read(out);
    fault_ = inflater_.fault();
    return received;
  }

 private:
  Inflater inflater_{[this](std::span<std::byte> in) { return file_.read(in); }};
};

// hands pieces to a consumer; after its error the rest is dropped
class ConsumerSink final : public VoxelSink {
 public:
  ConsumerSink(const VolumeFile& file, const Progress& progress, const VoxelConsumer& take)
      : size_(bytes_of(file.voxels.component)),
        count_(file.value_count()),
        progress_(progress),
        take_(take),
        buffer_(kPieceValues * size_) {}

  std::span<std::byte> buffer() override { return buffer_; }
  void commit(std::size_t bytes) override {
    if (taken_) taken_ = take_(first_, std::span(buffer_).first(bytes));
    first_ += bytes / size_;
    progress_.report("reading", static_cast<double>(first_) / static_cast<double>(count_));
  }
  void still_reading() override {}
  const Result<void>& taken() const { return taken_; }

 private:
  std::size_t size_;
  std::uint64_t count_, first_ = 0;
  const Progress& progress_;
  const VoxelConsumer& take_;
  std::vector<std::byte> buffer_;
  Result<void> taken_;
};

}  // namespace

std::unique_ptr<ByteStream> deflate_stream() {
  return std::make_unique<InflateStream>();
}

std::unique_ptr<ByteStream> bzip2_stream() {
  return nullptr;
}

std::string unpacked_front(const std::filesystem::path& file, std::size_t bytes) {
  const auto front = read_front(file, Encoding::kDeflate, bytes);
  return front ? *front : std::string();
}

// ---- volumes in this process

Result<VolumeReader> VolumeReader::open(const std::filesystem::path& file, const Progress& progress,
                                        std::optional<int> /*number*/, const GridGeometry* /*grid*/,
                                        const PlacementOptions& placement_options, ImageColours /*colours*/) {
  if (auto error = not_a_file(file)) return *std::move(error);
  auto opened = InputFile::open(file);
  if (!opened) return opened.error();
  const auto format = format_of(file);
  if (!format) {
    const auto kind = file_kind_of(file, unpacked_front);
    return kind ? bad_input(file.string(), "is " + kind->what + ", which a page does not read", kOnAComputer)
                : format.error();
  }
  VolumeReader reader(progress);
  reader.names_.push_back(file);
  reader.files_.push_back(*std::move(opened));
  OtherFiles known;
  // an .img, its .hdr, and the .img that this one requests
  constexpr std::size_t kMaxFiles = 3;
  while (true) {
    OtherFiles others = known;
    auto volume = inspect_file(**format, file, others, placement_options);
    if (!others.requested()) {
      if (!volume) return volume.error();
      volume->header.has_segments = !volume->segment_fields.empty();
      // only whether the file is large enough for what its header promises; memory is checked below
      constexpr std::uint64_t kMaxValues = std::uint64_t{1} << 31;
      if (count_values(*volume) < kMaxValues)
        if (auto plausible = check_plausible(*volume, 0); !plausible) return plausible.error();
      if (auto fits = check_size(*volume, file); !fits) return fits.error();
      reader.volume_ = *std::move(volume);
      name_format(**format, reader.volume_);
      return reader;
    }
    if (reader.files_.size() == kMaxFiles) return bad_input(file.string(), "names data files in a circle");
    const auto other = find_other_file(file, *others.requested());
    if (!other) return other.error();
    auto other_opened = InputFile::open(*other);
    if (!other_opened) return other_opened.error();
    reader.names_.push_back(*other);
    reader.files_.push_back(*std::move(other_opened));
    known.add(*others.requested(), *other);
  }
}

Result<void> VolumeReader::stream(const VoxelConsumer& take) {
  ConsumerSink sink(volume_, *progress_, take);
  auto sent = send_voxels(volume_, sink);
  if (!sink.taken()) return sink.taken().error();
  return sent;
}

// ---- nothing is cached

VoxelCacheEntry::VoxelCacheEntry(const VolumeReader& reader, std::string_view /*kind*/,
                                 VoxelCaching /*caching*/)
    : reader_(reader) {}
std::vector<std::vector<LabelId>> VoxelCacheEntry::find_labels(std::size_t /*layers*/) const {
  return {};
}
void VoxelCacheEntry::store_labels(const std::vector<std::vector<LabelId>>& /*layers*/) const {}
bool VoxelCacheEntry::find_scan(std::vector<float>& /*voxels*/, std::uint64_t& /*replaced*/) const {
  return false;
}
void VoxelCacheEntry::store_scan(const std::vector<float>& /*voxels*/, std::uint64_t /*replaced*/) const {}

// ---- formats that a page does not read: no file is taken for one of them

bool is_meshes(const std::filesystem::path& /*file*/) {
  return false;
}
bool is_masks(const std::filesystem::path& /*folder*/) {
  return false;
}
std::vector<std::filesystem::path> volumes_in(const std::filesystem::path& /*folder*/) {
  return {};
}
std::vector<std::filesystem::path> dicom_segmentation_files(const std::filesystem::path& /*file*/) {
  return {};
}

}  // namespace volume_io

bool is_dicom(const std::filesystem::path& /*file*/) {
  return false;
}
bool is_structure_set(const std::filesystem::path& /*file*/) {
  return false;
}
bool is_image_stack(const std::filesystem::path& /*file*/) {
  return false;
}

Result<Study> find_study(const std::filesystem::path& scan,
                         const std::optional<std::filesystem::path>& labels, std::optional<int> volume,
                         const Progress& /*progress*/) {
  return Study{.scan = scan, .volume = volume, .labels = labels, .notes = {}};
}

// ---- no process is started

namespace reader {

ReaderProcess::~ReaderProcess() = default;
Result<void> ReaderProcess::read(std::span<std::byte> /*bytes*/) {
  return Error{ErrorKind::kUnavailable, "a page starts no process", "", ""};
}

}  // namespace reader

void ChildProcess::end() {}

// ---- the only data sets are phantoms

Result<const CatalogEntry*> find_entry(const std::string& name) {
  static const CatalogEntry kPhantom{};
  if (is_phantom_name(name)) return &kPhantom;
  return Error{ErrorKind::kBadInput, "there is no data set with this name", name,
               "palpate in a browser generates phantoms: knee-phantom, palpation-block, palpation-dome"};
}

Result<LocalData> locate(const std::string& name) {
  return Error{ErrorKind::kUnavailable, "is not the name of a phantom", name, "give its files"};
}

}  // namespace palpate
