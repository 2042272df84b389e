#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <variant>

#include "palpate/reader/fields.h"
#include "volume_io/voxel_source.h"

/// What the process that reads a volume says to the one that wants it (volume_reader.h). The libraries in it
/// may have been led astray by the file, so the receiver believes nothing.
///
///   first, one of these:
///     byte 0    text what, text where, text remedy                                  a refusal
///     byte 1    the fields of a VolumeFile, in the order of send_volume()
///     byte 2    u8 which, text name                                                  another file is needed
///   then, each time that the voxels are wanted:
///     u32 n     the next slot holds n bytes of values; 0: there will be some later   as often as it takes
///     u32 ~0    and byte 1, or byte 0 with a refusal as above                        that was all
namespace palpate::volume_io {

/// A volume's other file, and how it is found from the one that the user named.
struct OtherFile {
  enum class Which : std::uint8_t {
    kNamed,   ///< by the header, as `name`
    kHeader,  ///< the .hdr of an .img
    kVoxels,  ///< the .img of a .hdr
  };
  Which which = Which::kNamed;
  std::string name;
  bool operator==(const OtherFile&) const = default;
};

inline constexpr std::uint32_t kStillReading = 0;
inline constexpr std::uint32_t kEnd = ~std::uint32_t{0};

/// Of a file the index in `files`, which are those that the process may read, the one that the user named
/// first.
using Files = std::span<const std::filesystem::path>;

bool send_refusal(reader::ByteTarget& target, const Error& refusal);
bool send_volume(reader::ByteTarget& target, const VolumeFile& volume, Files files);
bool send_wish(reader::ByteTarget& target, const OtherFile& wanted);
/// After the last voxel.
bool send_end(reader::ByteTarget& target, const Result<void>& read);

/// The first message. Errors: the refusal, or what is wrong with the message.
/// The format's and the type's names in the header are still to be filled in.
Result<std::variant<VolumeFile, OtherFile>> receive_answer(reader::ByteSource& source, Files files);
/// What follows kEnd.
Result<void> receive_end(reader::ByteSource& source, Files files);
/// An error of what the process sends, with the file that it is about and the remedy; others as they are.
Error about(Error error, Files files);
/// That the process says what no volume can be.
Error nonsense(Files files);

}  // namespace palpate::volume_io
