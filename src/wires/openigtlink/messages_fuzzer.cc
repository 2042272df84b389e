#include "palpate/openigtlink/messages.h"

// the input in one piece and byte by byte, also with a corrected checksum
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::vector<std::uint8_t> bytes(data, data + size);
  for (const bool mended : {false, true}) {
    if (mended && size >= palpate::igtl::kHeader_bytes) {
      const std::uint64_t crc = palpate::igtl::crc64(std::span(bytes).subspan(palpate::igtl::kHeader_bytes));
      for (int n = 0; n < 8; ++n) bytes[50 + n] = static_cast<std::uint8_t>(crc >> (56 - 8 * n));
    }
    std::uint64_t whole = 0, parts = 0;
    const auto count = [](std::uint64_t& poses) {
      return [&poses](const palpate::igtl::PoseMessage& message) {
        PALPATE_CHECK(message.rotation.allFinite() && message.at_mm.allFinite());
        ++poses;
      };
    };
    palpate::igtl::PoseReader at_once, by_bytes;
    const bool fine = at_once.consume(bytes, count(whole)).ok();
    bool fine_by_bytes = true;
    for (std::size_t n = 0; n < bytes.size() && fine_by_bytes; ++n)
      fine_by_bytes = by_bytes.consume(std::span(bytes).subspan(n, 1), count(parts)).ok();
    PALPATE_CHECK(fine == fine_by_bytes && whole == parts && at_once.damaged() == by_bytes.damaged());
  }
  return 0;
}
