#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// OpenIGTLink as a tracker's server speaks it (openigtlink.org, protocol 1 to 3). Numbers are big-endian.
///
///     0    u16       version, 1; 2 and 3 where what is said has words about it
///     2    char[12]  type: TRANSFORM, POSITION, TDATA, QTDATA ... filled up with zeros
///     14   char[20]  name: of a transform, "StylusToTracker"
///     34   u64       time stamp: seconds, and 2^-32 of one
///     42   u64       bytes of the body
///     50   u64       CRC-64 of the body
///     58             body; from version 2 on
///                    u16 bytes of this head (12), u16 and u32 bytes of the words' head and of the words, u32
///                    number | content | words' head: u16 how many; of each u16 key, u16 encoding, u32 value
///                    (bytes) | words
///
/// A pose is 12 float32, the columns of a matrix, or 7: place and quaternion (x y z w). TDATA and QTDATA hold
/// several, each behind its name (char[20]), a type and a zero. PLUS tells by a word whether a tool was seen
/// ("TransformStatus"; of TDATA its name and "Status"), and before version 2 of the protocol by the identity.
namespace palpate::igtl {

inline constexpr std::size_t kHead_bytes = 58;

/// A tool's pose, or that it was not seen.
struct PoseMessage {
  std::string name;         ///< bytes as they came
  bool seen = false;        ///< else the pose is none
  std::uint64_t stamp = 0;  ///< 2^-32 s of the server's own clock; 0: it says none
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
};

/// Takes bytes as they come, in pieces of any length. Bodies that are no poses are passed over without being
/// kept, so that it never holds more than 64 KiB.
class Reader {
 public:
  using Told = std::function<void(const PoseMessage&)>;

  /// Errors: kBadInput for what is no OpenIGTLink; nothing more can be read then.
  Result<void> take(std::span<const std::uint8_t> bytes, const Told& told);
  /// Messages of poses whose checksum was wrong, or that were cut short: nothing was told of them.
  std::uint64_t damaged() const { return damaged_; }

 private:
  Result<void> begin_body();
  void end_body(const Told& told);

  std::vector<std::uint8_t> head_, body_;
  std::uint64_t missing_ = 0;  // bytes of the body
  bool is_in_body_ = false, is_kept_ = false;
  std::uint64_t damaged_ = 0;
};

/// What a client says first: a STATUS (fine) of version 2, by which a server knows that it may speak that.
std::vector<std::uint8_t> greeting();

/// CRC-64 (ECMA 182) as the protocol has it.
std::uint64_t crc64(std::span<const std::uint8_t> bytes);

}  // namespace palpate::igtl
