#include "volume_io/image/image_stack.h"

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <cstring>

#include "palpate/base/file.h"
#include "volume_io/dicom/dicom.h"
#include "volume_io/formats/formats.h"
#include "volume_io/image/image.h"
#include "volume_io/labels/label_text.h"
#include "volume_io/labels/layered_labels.h"
#include "volume_io/labels/masks.h"
#include "volume_io/mesh/meshes.h"

namespace palpate::volume_io {
namespace {

namespace fs = std::filesystem;

// ---- finding files ------------------------------------------------------------------------------

bool has_image_name(const fs::path& file) {
  return std::ranges::any_of(std::array{".png", ".jpg", ".jpeg", ".tif", ".tiff"},
                             [&](const char* ending) { return has_extension(file, ending); });
}

bool is_image(const fs::path& file) {
  const auto front = read_front(file, Encoding::kRaw, 8);
  return front && image_format_of(*front).has_value();
}

// the format that supports several pages
bool is_tiff(const fs::path& file) {
  const auto front = read_front(file, Encoding::kRaw, 8);
  return front && image_format_of(*front) == ImageFormat::kTiff;
}

// Files are selected by extension, without opening each of a thousand; the content of one is checked by
// is_image_stack().
StructureFiles find_images(const fs::path& named) {
  std::error_code failed;
  if (!fs::is_directory(named, failed)) return find_structure_files(named, is_tiff, "picture");
  StructureFiles found = find_structure_files(named, has_image_name, "picture");
  std::ranges::sort(found.files, [](const fs::path& one, const fs::path& other) {
    return natural_less(one.filename().string(), other.filename().string());
  });
  return found;
}

// ---- in the reader process ----------------------------------------------------------------------

/// A slice: one page of a file.
struct SlicePicture {
  std::size_t file = 0, page = 0;
};

/// Opens one file at a time; the pages of a file are consecutive.
class PictureReader {
 public:
  explicit PictureReader(const std::vector<fs::path>& files) : files_(files) {}

  Result<ImageDecoder*> open(std::size_t n) {
    if (decoder_ && opened_ == n) return decoder_.get();
    decoder_.reset();
    auto input = InputFile::open(files_[n]);
    if (!input) return input.error();
    input_ = *std::move(input);
    auto decoder = open_image({input_->size(), [this](std::uint64_t offset, std::span<std::byte> bytes) {
                                 const auto received = input_->read_at(offset, bytes);
                                 return received && *received == bytes.size();
                               }});
    if (!decoder) return at(decoder.error(), n);
    decoder_ = *std::move(decoder);
    opened_ = n;
    return decoder_.get();
  }
  Result<void> read(const SlicePicture& slice, std::span<std::uint32_t> pixels) {
    const auto decoder = open(slice.file);
    if (!decoder) return decoder.error();
    if (slice.page >= (*decoder)->pages().size() || (*decoder)->pages()[slice.page].pixels() != pixels.size())
      return at(bad_input("", "changed while it was read", "do not change the files while they are read"),
                slice.file);
    if (auto read = (*decoder)->read(slice.page, pixels); !read) return at(read.error(), slice.file);
    return {};
  }
  Error at(Error error, std::size_t n) const {
    error.where = files_[n].string();
    return error;
  }

 private:
  const std::vector<fs::path>& files_;
  std::optional<InputFile> input_;
  std::unique_ptr<ImageDecoder> decoder_;
  std::size_t opened_ = 0;
};

/// A parsed stack.
struct ImageStack {
  std::vector<fs::path> files;
  std::vector<SlicePicture> slices;
  ImageShape shape;
  bool grey_in_colour = false;  // all colours are greys
  ImageColours meaning = ImageColours::kLabels;
  std::vector<std::uint32_t> label_colours;  // ascending; label n + 1 has the n-th colour
  VolumeFile file;
};

std::string kind_in_words(const ImageShape& shape) {
  return std::to_string(shape.columns) + " x " + std::to_string(shape.rows) + " pixels " +
         (shape.colour ? std::string("in colours") : std::string("of ") + name_of(shape.component));
}

constexpr std::uint32_t luminance(std::uint32_t rgb) {
  // ITU-R BT.709 weights, in thousandths
  constexpr std::uint32_t kRed = 213, kGreen = 715, kBlue = 72;
  return (kRed * (rgb >> 16) + kGreen * (rgb >> 8 & 0xFF) + kBlue * (rgb & 0xFF) + 500) / 1000;
}

// collects the pages of all files, which must agree in size and kind
Result<void> find_slices(PictureReader& reader, const std::function<bool()>& should_continue,
                         ImageStack& stack) {
  constexpr std::size_t kMaxSlices = 20'000;
  for (std::size_t n = 0; n < stack.files.size(); ++n) {
    if (!should_continue()) return bad_input("", "reading was interrupted");
    const auto decoder = reader.open(n);
    if (!decoder) return decoder.error();
    const auto& pages = (*decoder)->pages();
    for (std::size_t page = 0; page < pages.size(); ++page) {
      if (stack.slices.empty()) stack.shape = pages[page];
      if (!(pages[page] == stack.shape)) {
        const auto named = [&](std::size_t file, std::size_t p) {
          return stack.files[file].filename().string() +
                 (stack.files.size() == 1 ? ", page " + std::to_string(p + 1) : "");
        };
        return reader.at(
            bad_input(
                "",
                "has slices that differ: " + named(0, 0) + " has " + kind_in_words(stack.shape) + ", " +
                    named(n, page) + " has " + kind_in_words(pages[page]),
                "give slices of the same size and kind: remove other files, or export the slices again"),
            n);
      }
      stack.slices.push_back({n, page});
    }
    if (stack.slices.size() > kMaxSlices)
      return bad_input("", "has more than " + std::to_string(kMaxSlices) + " slices", "give fewer of them");
  }
  return {};
}

// collects the distinct 24-bit colours
Result<void> find_colours(PictureReader& reader, const std::function<bool()>& should_continue,
                          double& fraction, ImageStack& stack) {
  std::vector<bool> present(std::size_t{1} << 24);
  std::vector<std::uint32_t> pixels(stack.shape.pixels());
  bool grey = true;
  for (std::size_t k = 0; k < stack.slices.size(); ++k) {
    if (!should_continue()) return bad_input("", "reading was interrupted");
    fraction = static_cast<double>(k) / static_cast<double>(stack.slices.size());
    if (auto read = reader.read(stack.slices[k], pixels); !read) return read;
    std::uint32_t last = 0;
    for (const std::uint32_t pixel : pixels) {
      if (pixel == last) continue;
      last = pixel;
      present[pixel] = true;
      grey = grey && (pixel >> 16) == (pixel & 0xFF) && (pixel >> 8 & 0xFF) == (pixel & 0xFF);
    }
  }
  stack.grey_in_colour = grey;
  if (grey || stack.meaning == ImageColours::kGrey) return {};
  std::size_t count = 0;
  constexpr std::size_t kMaxColours = 4096;
  for (std::uint32_t colour = 1; colour < present.size(); ++colour) {
    if (!present[colour]) continue;
    if (++count <= kMaxColours) stack.label_colours.push_back(colour);
  }
  if (count <= kMaxColours) return {};
  return bad_input("",
                   "has " + std::to_string(count) + " distinct colours besides black, but at most " +
                       std::to_string(kMaxColours) + " can be read as labels, one per structure",
                   "save labels as PNG without smoothing at their edges; to read photographs by their "
                   "brightness, give them as the scan (--scan)");
}

Result<ImageStack> inspect_stack(const StructureFiles& found, const fs::path& named,
                                 const Eigen::Vector3d& spacing_mm, ImageColours colours,
                                 const std::function<bool()>& should_continue, double& fraction) {
  ImageStack stack;
  stack.files = found.files;
  stack.meaning = colours;
  PictureReader reader(stack.files);
  if (auto alike = find_slices(reader, should_continue, stack); !alike) return alike.error();
  if (stack.slices.size() < 2)
    return bad_input(named.string(), "is a single picture, but a volume has several slices",
                     "give the folder with all slices, or a TIFF with several pages");
  if (stack.shape.colour)
    if (auto known = find_colours(reader, should_continue, fraction, stack); !known) return known.error();

  GridGeometry grid;
  grid.dims = {stack.shape.columns, stack.shape.rows, static_cast<int>(stack.slices.size())};
  grid.spacing_mm = spacing_mm;
  VolumeFile& file = stack.file;
  if (stack.label_colours.empty()) {
    file.header.geometry = grid;
    file.voxels.file = named;
    file.voxels.encoding = Encoding::kSlices;
    file.voxels.component = stack.shape.component;
  } else {
    file = labels_in_slices(grid, named);
    for (std::size_t n = 0; n < stack.label_colours.size(); ++n) {
      const std::uint32_t colour = stack.label_colours[n];
      char text[64];
      std::snprintf(text, sizeof text, "%.6f %.6f %.6f", (colour >> 16) / 255.0, (colour >> 8 & 0xFF) / 255.0,
                    (colour & 0xFF) / 255.0);
      put_segment(file, n, "", static_cast<int>(n + 1), 0, text);
    }
    file.notes.push_back("is read as labels, one for each of its " +
                         std::to_string(stack.label_colours.size()) +
                         " colours, with black as background; a table with the colours can name them");
  }
  file.header.has_geometry = false;
  file.notes.insert(file.notes.end(), found.notes.begin(), found.notes.end());
  if (stack.shape.colour && stack.label_colours.empty() && !stack.grey_in_colour)
    file.notes.push_back("is in colour and read as a scan by its brightness (ITU-R BT.709)");
  return stack;
}

Result<void> send_stack(const ImageStack& stack, VoxelSink& sink) {
  PictureReader reader(stack.files);
  std::vector<std::uint32_t> pixels(stack.shape.pixels());
  const auto value_of = [&](std::uint32_t pixel) -> std::uint32_t {
    if (!stack.shape.colour) return pixel;
    if (stack.label_colours.empty()) return stack.grey_in_colour ? pixel & 0xFF : luminance(pixel);
    const auto found = std::ranges::lower_bound(stack.label_colours, pixel);
    return found == stack.label_colours.end() || *found != pixel
               ? 0
               : static_cast<std::uint32_t>(found - stack.label_colours.begin()) + 1;
  };
  const std::size_t value_bytes = bytes_of(stack.file.voxels.component);
  for (const SlicePicture& slice : stack.slices) {
    sink.still_reading();
    if (auto read = reader.read(slice, pixels); !read) return read;
    std::uint32_t last = 0, value = value_of(0);
    for (std::size_t first = 0; first < pixels.size(); first += kPieceValues) {
      const std::size_t count = std::min(kPieceValues, pixels.size() - first);
      const auto buffer = sink.buffer().first(count * value_bytes);
      for (std::size_t n = 0; n < count; ++n) {
        if (const std::uint32_t pixel = pixels[first + n]; pixel != last) {
          last = pixel;
          value = value_of(pixel);
        }
        // the low bytes of the value, regardless of the machine's byte order
        if (value_bytes == 1) {
          buffer[n] = static_cast<std::byte>(value);
        } else if (value_bytes == 2) {
          const auto word = static_cast<std::uint16_t>(value);
          std::memcpy(buffer.data() + 2 * n, &word, 2);
        } else {
          std::memcpy(buffer.data() + 4 * n, &value, 4);
        }
      }
      sink.commit(buffer.size());
    }
  }
  return {};
}

}  // namespace

bool natural_less(std::string_view one, std::string_view other) {
  const auto is_digit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t a = 0, b = 0;
  while (a < one.size() && b < other.size()) {
    if (!is_digit(one[a]) || !is_digit(other[b])) {
      const auto low = [](char c) { return std::tolower(static_cast<unsigned char>(c)); };
      if (low(one[a]) != low(other[b])) return low(one[a]) < low(other[b]);
      ++a, ++b;
      continue;
    }
    const auto number_at = [&](std::string_view text, std::size_t& at) {
      while (at < text.size() && text[at] == '0') ++at;
      const std::size_t first = at;
      while (at < text.size() && is_digit(text[at])) ++at;
      return text.substr(first, at - first);
    };
    const std::string_view x = number_at(one, a), y = number_at(other, b);
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if (a != one.size() || b != other.size()) return b != other.size();
  // equal except for leading zeros and capitals
  return one < other;
}

Result<LabelReader> open_image_stack(const fs::path& file, const std::optional<Eigen::Vector3d>& spacing_mm,
                                     ImageColours colours, const Progress& progress) {
  const StructureFiles found = find_images(file);
  if (!spacing_mm)
    return bad_input(
        file.string(),
        "is " +
            (found.files.size() == 1 ? std::string("a picture or pages of pictures")
                                     : "a stack of " + std::to_string(found.files.size()) + " pictures") +
            " without a voxel spacing",
        "give it with --spacing X,Y,Z: mm between columns, rows and slices, such as --spacing 0.05,0.05,0.1 "
        "(in a scene file: image_spacing = [0.05, 0.05, 0.1])");
  // dropping slices silently would distort the volume
  if (found.is_cut_off)
    return bad_input(file.string(), found.notes.front(),
                     "save the stack as one TIFF with several pages, or as fewer slices");
  return open_sliced_files(
      found, file, progress,
      [&, spacing = *spacing_mm](const std::function<bool()>& should_continue,
                                 double& fraction) -> Result<SlicedVolume> {
        auto stack = inspect_stack(found, file, spacing, colours, should_continue, fraction);
        if (!stack) return stack.error();
        const auto stored = std::make_shared<const ImageStack>(*std::move(stack));
        return SlicedVolume{stored->file, [stored](VoxelSink& sink) { return send_stack(*stored, sink); }};
      },
      "crop or scale the pictures first, as in Fiji");
}

}  // namespace palpate::volume_io

namespace palpate {

using namespace volume_io;

bool is_image_stack(const std::filesystem::path& file) {
  std::error_code failed;
  if (!std::filesystem::is_directory(file, failed))
    return std::filesystem::is_regular_file(file, failed) && !format_of(file) && is_tiff(file);
  // tested by names only, before any file is opened
  if (!volumes_in(file).empty()) return false;
  const auto images = find_images(file).files;
  return !images.empty() && is_image(images.front()) && !is_meshes(file) && !is_dicom(file);
}

}  // namespace palpate
