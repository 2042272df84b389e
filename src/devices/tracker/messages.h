#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// OpenIGTLink messages of a tracker's server (openigtlink.org, protocol versions 1 to 3). Big-endian.
///
///    0    u16       version: 1, or 2 and 3 if metadata follow the content
///    2    char[12]  type: TRANSFORM, POSITION, TDATA, QTDATA ..., zero-padded
///    14   char[20]  name: of a transform, "StylusToTracker"
///    34   u64       time stamp: seconds, in units of 2^-32 s
///    42   u64       size of the body in bytes
///    50   u64       CRC-64 of the body
///    58             body; from version 2 on
///                   u16 size of this extended head (12), u16 and u32 sizes of the metadata head and of the
///                   metadata, u32 number | content | metadata head: u16 count; for each entry u16 key
///                   size, u16 encoding, u32 value size | metadata
///
/// A pose is 12 float32, the columns of a matrix, or 7: position and quaternion (x y z w). TDATA and QTDATA
/// contain several, each after its name (char[20]), a type and a zero. PLUS reports in the metadata whether a
/// tool was seen ("TransformStatus"; for TDATA its name and "Status"), and before version 2 of the protocol
/// by an identity matrix.
namespace palpate::igtl {

inline constexpr std::size_t kHead_bytes = 58;

/// Pose of a tool, or the report that it was not seen.
struct PoseMessage {
  std::string name;         ///< Raw bytes
  bool seen = false;        ///< If false, the pose is invalid
  std::uint64_t stamp = 0;  ///< Server time in 2^-32 s; 0: none
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
};

/// Incremental parser for input in pieces of any size. Bodies other than poses are skipped without buffering,
/// so memory stays below 64 KiB.
class Reader {
 public:
  using Told = std::function<void(const PoseMessage&)>;

  /// Errors: kBadInput if the input is not OpenIGTLink; the reader is then unusable.
  Result<void> take(std::span<const std::uint8_t> bytes, const Told& told);
  /// Number of pose messages that were dropped because of a wrong checksum or length.
  std::uint64_t damaged() const { return damaged_; }

 private:
  Result<void> begin_body();
  void end_body(const Told& told);

  std::vector<std::uint8_t> head_, body_;
  std::uint64_t missing_ = 0;  // remaining bytes of the body
  bool is_in_body_ = false, is_kept_ = false;
  std::uint64_t damaged_ = 0;
};

/// First message of a client: a STATUS (OK) of version 2, which tells the server that it may use that
/// version.
std::vector<std::uint8_t> greeting();

/// CRC-64 (ECMA 182) as the protocol uses it.
std::uint64_t crc64(std::span<const std::uint8_t> bytes);

}  // namespace palpate::igtl
