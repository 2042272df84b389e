#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <variant>

#include "palpate/reader/fields.h"
#include "volume_io/voxel_source.h"

/// Messages from a reader process to its parent (volume_reader.h). Libraries in the reader process may have
/// been compromised by the file, so the receiver validates everything.
///
///   first, one of:
///     byte 0    text what, text where, text remedy                                  refusal
///     byte 1    fields of a VolumeFile, in the order of send_volume()
///     byte 2    u8 which, text name                                                 request for a file
///   then, each time that the voxels are requested:
///     u32 n     the next slot holds n bytes of values; 0: still reading              repeated
///     u32 ~0    then byte 1, or byte 0 and a refusal as above                        end
namespace palpate::volume_io {

/// Additional file of a volume, and how to find it from the file that the user named.
struct OtherFile {
  enum class Which : std::uint8_t {
    kNamed,   ///< Named by the header, as `name`.
    kHeader,  ///< The .hdr of an .img.
    kVoxels,  ///< The .img of a .hdr.
  };
  Which which = Which::kNamed;
  std::string name;
  bool operator==(const OtherFile&) const = default;
};

inline constexpr std::uint32_t kStillReading = 0;
inline constexpr std::uint32_t kEnd = ~std::uint32_t{0};

/// Files that the process may read, the one that the user named first; messages refer to them by index.
using Files = std::span<const std::filesystem::path>;

bool send_refusal(reader::ByteTarget& target, const Error& refusal);
bool send_volume(reader::ByteTarget& target, const VolumeFile& volume, Files files);
bool send_file_request(reader::ByteTarget& target, const OtherFile& requested);
/// Sent after the last voxel.
bool send_end(reader::ByteTarget& target, const Result<void>& read);

/// Receives the first message. Errors: the refusal, or an invalid message. The names of format and type in
/// the header are filled in by the caller.
Result<std::variant<VolumeFile, OtherFile>> receive_answer(reader::ByteSource& source, Files files);
/// Receives the message that follows kEnd.
Result<void> receive_end(reader::ByteSource& source, Files files);
/// Adds file and remedy to a kBadInput without `where`; other errors are returned unchanged.
Error about(Error error, Files files);
/// Error for a message that no valid volume can produce.
Error impossible_volume(Files files);

}  // namespace palpate::volume_io
