#include "volume_io/volume_message.h"

#include <cstdlib>
#include <cstring>

namespace {

using namespace palpate;
using namespace palpate::volume_io;

class Input : public reader::ByteSource {
 public:
  Input(const std::uint8_t* data, std::size_t size) : remaining_(data, size) {}
  Result<void> read(std::span<std::byte> bytes) override {
    if (bytes.size() > remaining_.size()) return Error{ErrorKind::kBadInput, "ended", "", ""};
    if (!bytes.empty()) std::memcpy(bytes.data(), remaining_.data(), bytes.size());
    remaining_ = remaining_.subspan(bytes.size());
    return {};
  }

 private:
  std::span<const std::uint8_t> remaining_;
};

void must(bool condition) {
  if (!condition) std::abort();
}

}  // namespace

// Messages that a compromised process might send; the results must satisfy the bounds on which the reader
// relies.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::vector<std::filesystem::path> files{"named", "other"};
  Input input(data, size), again(data, size);
  const auto answer = receive_answer(input, files);
  if (!answer) {
    must(!answer.error().what.empty() && !answer.error().where.empty());
  } else if (const auto* volume = std::get_if<VolumeFile>(&*answer)) {
    must(volume->value_count() >= 1 && volume->value_count() <= std::uint64_t{1} << 52);
    must(volume->header.geometry.min_spacing_mm() > 0);
    must(volume->voxels.file == "named" || volume->voxels.file == "other");
    must(bytes_of(volume->voxels.component) <= 8);
  }
  if (const auto end = receive_end(again, files); !end) must(!end.error().what.empty());
  return 0;
}
