#include "volume_io/dicom/test_jpeg2000.h"

#include <openjpeg.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "palpate/base/check.h"

namespace palpate::test {
namespace {

struct PackedTarget {
  std::vector<std::uint8_t> bytes;
  std::size_t at = 0;
};

OPJ_SIZE_T write_packed(void* data, OPJ_SIZE_T count, void* user) {
  auto& target = *static_cast<PackedTarget*>(user);
  target.bytes.resize(std::max(target.bytes.size(), target.at + count));
  std::copy_n(static_cast<const std::uint8_t*>(data), count,
              target.bytes.begin() + static_cast<std::ptrdiff_t>(target.at));
  target.at += count;
  return count;
}
OPJ_OFF_T skip_target(OPJ_OFF_T count, void* user) {
  static_cast<PackedTarget*>(user)->at += static_cast<std::size_t>(count);
  return count;
}
OPJ_BOOL seek_target(OPJ_OFF_T offset, void* user) {
  static_cast<PackedTarget*>(user)->at = static_cast<std::size_t>(offset);
  return OPJ_TRUE;
}

}  // namespace

std::vector<std::uint8_t> pack_jpeg2000(int rows, int columns, std::span<const std::int32_t> values,
                                        const Jpeg2000Coding& coding) {
  opj_image_cmptparm_t component{};
  component.dx = component.dy = 1;
  component.w = static_cast<OPJ_UINT32>(columns);
  component.h = static_cast<OPJ_UINT32>(rows);
  component.prec = static_cast<OPJ_UINT32>(coding.bits);
  component.sgnd = coding.is_signed;
  opj_image_t* image = opj_image_create(1, &component, OPJ_CLRSPC_GRAY);
  PALPATE_CHECK(image != nullptr && values.size() == std::size_t{component.w} * component.h);
  image->x1 = component.w;
  image->y1 = component.h;
  std::copy(values.begin(), values.end(), image->comps[0].data);

  opj_cparameters_t parameters;
  opj_set_default_encoder_parameters(&parameters);
  const int edge = coding.tile > 0 ? std::min({rows, columns, coding.tile}) : std::min(rows, columns);
  parameters.numresolution = std::min(6, static_cast<int>(std::bit_width(static_cast<unsigned>(edge))));
  parameters.irreversible = coding.irreversible;
  parameters.tcp_numlayers = coding.layers;
  for (int layer = 0; layer < coding.layers; ++layer)
    parameters.tcp_rates[layer] = static_cast<float>((coding.layers - 1 - layer) * 4);
  if (coding.irreversible) parameters.tcp_rates[coding.layers - 1] = 5;
  parameters.cp_disto_alloc = 1;
  if (coding.tile > 0) {
    parameters.tile_size_on = OPJ_TRUE;
    parameters.cp_tdx = parameters.cp_tdy = coding.tile;
  }
  opj_codec_t* codec = opj_create_compress(OPJ_CODEC_J2K);
  opj_stream_t* stream = opj_stream_create(OPJ_J2K_STREAM_CHUNK_SIZE, OPJ_FALSE);
  PackedTarget target;
  opj_stream_set_user_data(stream, &target, nullptr);
  opj_stream_set_write_function(stream, write_packed);
  opj_stream_set_skip_function(stream, skip_target);
  opj_stream_set_seek_function(stream, seek_target);
  PALPATE_CHECK(opj_setup_encoder(codec, &parameters, image) && opj_start_compress(codec, image, stream) &&
                opj_encode(codec, stream) && opj_end_compress(codec, stream));
  opj_stream_destroy(stream);
  opj_destroy_codec(codec);
  opj_image_destroy(image);
  return std::move(target.bytes);
}

}  // namespace palpate::test
