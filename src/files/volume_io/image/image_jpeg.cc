#include <cstdio>
// jpeglib.h requires the headers above
#include <jpeglib.h>

#include <csetjmp>
#include <string>

#include "volume_io/image/image.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {
namespace {

// error handler of libjpeg with the jump target of its longjmp()
struct Escape {
  jpeg_error_mgr manager;
  std::jmp_buf error_jump;
};

[[noreturn]] void fail(j_common_ptr jpeg) {
  std::longjmp(reinterpret_cast<Escape*>(jpeg->err)->error_jump, 1);
}
// libjpeg warns about damage and fills it with grey: treated as an error.
void warn(j_common_ptr jpeg, int level) {
  if (level < 0) fail(jpeg);
}
void print_nothing(j_common_ptr) {}

// a progressive image can demand any number of passes over all its pixels
void count_scans(j_common_ptr jpeg) {
  constexpr int kMaxScans = 200;
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number > kMaxScans) fail(jpeg);
}

struct Decompressor {
  jpeg_decompress_struct jpeg{};
  jpeg_progress_mgr progress{};
  Escape escape{};
  ~Decompressor() { jpeg_destroy_decompress(&jpeg); }
};

// No object with a destructor may live in these two functions, which libjpeg leaves by longjmp(). They return
// false if the data are damaged.
bool read_header(Decompressor& d, const unsigned char* bytes, std::size_t count) {
  d.jpeg.err = jpeg_std_error(&d.escape.manager);
  d.escape.manager.error_exit = fail;
  d.escape.manager.emit_message = warn;
  d.escape.manager.output_message = print_nothing;
  if (setjmp(d.escape.error_jump)) return false;
  jpeg_create_decompress(&d.jpeg);
  d.progress.progress_monitor = count_scans;
  d.jpeg.progress = &d.progress;
  jpeg_mem_src(&d.jpeg, bytes, static_cast<unsigned long>(count));
  return jpeg_read_header(&d.jpeg, TRUE) == JPEG_HEADER_OK;
}

bool read_rows(Decompressor& d, bool colour, unsigned char* values, std::size_t row_bytes) {
  if (setjmp(d.escape.error_jump)) return false;
  d.jpeg.out_color_space = colour ? JCS_RGB : JCS_GRAYSCALE;
  d.jpeg.dct_method = JDCT_ISLOW;
  jpeg_start_decompress(&d.jpeg);
  while (d.jpeg.output_scanline < d.jpeg.output_height) {
    JSAMPROW row = values + d.jpeg.output_scanline * row_bytes;
    jpeg_read_scanlines(&d.jpeg, &row, 1);
  }
  return jpeg_finish_decompress(&d.jpeg) == TRUE;
}

class JpegDecoder : public ImageDecoder {
 public:
  JpegDecoder(std::string bytes, const ImageShape& shape) : bytes_(std::move(bytes)) { pages_ = {shape}; }

  Result<void> read(std::size_t, std::span<std::uint32_t> pixels) override {
    const ImageShape& shape = pages_.front();
    const std::size_t pixel_bytes = shape.colour ? 3 : 1,
                      row_bytes = pixel_bytes * static_cast<std::size_t>(shape.columns);
    std::vector<unsigned char> values(row_bytes * static_cast<std::size_t>(shape.rows));
    Decompressor d;
    if (!read_header(d, reinterpret_cast<const unsigned char*>(bytes_.data()), bytes_.size()) ||
        !read_rows(d, shape.colour, values.data(), row_bytes))
      return bad_input("", kDamagedImage, kCopyImage);
    for (std::size_t n = 0; n < pixels.size(); ++n) {
      const unsigned char* value = values.data() + n * pixel_bytes;
      pixels[n] =
          shape.colour ? static_cast<std::uint32_t>(value[0] << 16 | value[1] << 8 | value[2]) : value[0];
    }
    return {};
  }

 private:
  std::string bytes_;
};

}  // namespace

Result<std::unique_ptr<ImageDecoder>> open_jpeg(ImageBytes source) {
  if (source.size > kMaxImageBytes)
    return bad_input("", "is a JPEG file of more than 512 MiB", "save it as TIFF");
  std::string bytes(static_cast<std::size_t>(source.size), '\0');
  if (!source.read(0, std::as_writable_bytes(std::span(bytes))))
    return bad_input("", kDamagedImage, kCopyImage);
  ImageShape shape;
  {
    Decompressor d;
    if (!read_header(d, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size()))
      return bad_input("", kDamagedImage, kCopyImage);
    if (auto possible = check_image_size(d.jpeg.image_width, d.jpeg.image_height); !possible)
      return possible.error();
    if (d.jpeg.num_components != 1 && d.jpeg.num_components != 3)
      return bad_input("", "is a CMYK JPEG picture", "save it as grey or RGB");
    shape.columns = static_cast<int>(d.jpeg.image_width);
    shape.rows = static_cast<int>(d.jpeg.image_height);
    shape.colour = d.jpeg.num_components == 3;
  }
  return std::unique_ptr<ImageDecoder>(std::make_unique<JpegDecoder>(std::move(bytes), shape));
}

}  // namespace palpate::volume_io
