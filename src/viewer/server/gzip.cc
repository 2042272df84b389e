#include <zlib.h>

#include <algorithm>

#include "server/volume_payload.h"

namespace palpate::server {

std::shared_ptr<const std::string> gzip(const std::string& bytes, const std::atomic<bool>& stop, int level) {
  constexpr int kGzipWindow = 15 + 16, kMemory = 8;
  constexpr std::size_t kPart_bytes = std::size_t{1} << 20;
  z_stream stream{};
  if (deflateInit2(&stream, level, Z_DEFLATED, kGzipWindow, kMemory, Z_DEFAULT_STRATEGY) != Z_OK)
    return nullptr;
  auto packed = std::make_shared<std::string>();
  std::string out(kPart_bytes, '\0');
  std::size_t used = 0;
  bool last = false;
  while (!last && !stop) {
    const std::size_t part = std::min(kPart_bytes, bytes.size() - used);
    // zlib does not modify its input
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data() + used));
    stream.avail_in = static_cast<uInt>(part);
    used += part;
    last = used == bytes.size();
    do {
      stream.next_out = reinterpret_cast<Bytef*>(out.data());
      stream.avail_out = static_cast<uInt>(out.size());
      deflate(&stream, last ? Z_FINISH : Z_NO_FLUSH);
      packed->append(out, 0, out.size() - stream.avail_out);
    } while (stream.avail_out == 0);
  }
  deflateEnd(&stream);
  if (!last) return nullptr;
  return packed;
}

}  // namespace palpate::server
