#include "volume_io/dicom/dicom_jpeg2000.h"

#include <openjpeg.h>

#include <algorithm>
#include <cstring>
#include <memory>

namespace palpate::volume_io {
namespace {

// codestream with a read position, for OpenJPEG's callbacks
struct PackedSource {
  std::span<const std::uint8_t> bytes;
  std::size_t at = 0;
};

constexpr OPJ_SIZE_T kNoMore = static_cast<OPJ_SIZE_T>(-1);

OPJ_SIZE_T read_packed(void* target, OPJ_SIZE_T bytes, void* user) {
  auto& source = *static_cast<PackedSource*>(user);
  const std::size_t count = std::min<std::size_t>(bytes, source.bytes.size() - source.at);
  if (count == 0) return kNoMore;
  std::memcpy(target, source.bytes.data() + source.at, count);
  source.at += count;
  return count;
}

OPJ_OFF_T skip_packed(OPJ_OFF_T bytes, void* user) {
  auto& source = *static_cast<PackedSource*>(user);
  const std::size_t left = source.bytes.size() - source.at;
  if (bytes < 0 || left == 0) return -1;
  const std::size_t count = std::min(static_cast<std::size_t>(bytes), left);
  source.at += count;
  return static_cast<OPJ_OFF_T>(count);
}

OPJ_BOOL seek_packed(OPJ_OFF_T offset, void* user) {
  auto& source = *static_cast<PackedSource*>(user);
  if (offset < 0 || static_cast<std::size_t>(offset) > source.bytes.size()) return OPJ_FALSE;
  source.at = static_cast<std::size_t>(offset);
  return OPJ_TRUE;
}

struct CodecEnd {
  void operator()(opj_codec_t* codec) const { opj_destroy_codec(codec); }
};
struct StreamEnd {
  void operator()(opj_stream_t* stream) const { opj_stream_destroy(stream); }
};
struct ImageEnd {
  void operator()(opj_image_t* image) const { opj_image_destroy(image); }
};

}  // namespace

bool unpack_jpeg2000(const Jpeg2000Header& header, std::span<const std::uint8_t> packed,
                     std::size_t word_bytes, std::span<std::uint8_t> words) {
  PackedSource source{packed};
  const std::unique_ptr<opj_stream_t, StreamEnd> stream(
      opj_stream_create(OPJ_J2K_STREAM_CHUNK_SIZE, OPJ_TRUE));
  const std::unique_ptr<opj_codec_t, CodecEnd> codec(opj_create_decompress(OPJ_CODEC_J2K));
  if (!stream || !codec) return false;
  opj_stream_set_user_data(stream.get(), &source, nullptr);
  opj_stream_set_user_data_length(stream.get(), packed.size());
  opj_stream_set_read_function(stream.get(), read_packed);
  opj_stream_set_skip_function(stream.get(), skip_packed);
  opj_stream_set_seek_function(stream.get(), seek_packed);
  opj_dparameters_t parameters;
  opj_set_default_decoder_parameters(&parameters);
  if (!opj_setup_decoder(codec.get(), &parameters) || !opj_decoder_set_strict_mode(codec.get(), OPJ_TRUE))
    return false;

  opj_image_t* made = nullptr;
  const bool begun = opj_read_header(stream.get(), codec.get(), &made) != OPJ_FALSE;
  const std::unique_ptr<opj_image_t, ImageEnd> image(made);
  if (!begun || !image || !opj_decode(codec.get(), stream.get(), image.get()) ||
      !opj_end_decompress(codec.get(), stream.get()))
    return false;
  const opj_image_comp_t& samples = image->comps[0];
  if (image->numcomps != 1 || samples.w != header.columns || samples.h != header.rows ||
      samples.data == nullptr || words.size() != std::size_t{samples.w} * samples.h * word_bytes)
    return false;
  for (std::size_t n = 0; n < words.size() / word_bytes; ++n) {
    const auto word = static_cast<std::uint32_t>(samples.data[n]);
    for (std::size_t byte = 0; byte < word_bytes; ++byte)
      words[n * word_bytes + byte] = static_cast<std::uint8_t>(word >> (8 * byte));
  }
  return true;
}

}  // namespace palpate::volume_io
