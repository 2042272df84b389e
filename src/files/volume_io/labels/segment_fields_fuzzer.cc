#include <algorithm>

#include "palpate/volume_io/label_tables.h"

// the first byte is the number of layers, followed by "key=value" texts separated by zero bytes
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  std::vector<std::pair<std::string, std::string>> fields;
  const auto* text = reinterpret_cast<const char*>(data);
  for (std::size_t at = 1; at < size;) {
    const auto* end = std::find(text + at, text + size, '\0');
    const std::string line(text + at, end);
    const auto equals = std::min(line.find('='), line.size());
    fields.emplace_back(line.substr(0, equals), line.substr(std::min(equals + 1, line.size())));
    at = static_cast<std::size_t>(end - text) + 1;
  }
  const int layers = 1 + data[0] % 4;
  const auto segments = palpate::parse_segment_fields(fields, layers, "fuzz");
  if (!segments) return 0;
  // invariants on which callers rely
  int last = 0;
  for (const palpate::Segment& s : *segments) {
    PALPATE_CHECK(s.id > last && s.value != 0 && s.layer >= 0 && s.layer < layers);
    last = s.id;
  }
  return 0;
}
