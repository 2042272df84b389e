#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"

/// Decoding of OpenIGTLink messages (openigtlink.org, protocol versions 1 to 3). Big-endian.
///
///    0    u16       version: 1, or 2 and 3 if metadata follow the content
///    2    char[12]  type: TRANSFORM, POSITION, TDATA, QTDATA ..., zero-padded
///    14   char[20]  name: of a transform, "StylusToTracker"
///    34   u64       time stamp: seconds, in units of 2^-32 s
///    42   u64       size of the body in bytes
///    50   u64       CRC-64 of the body
///    58             body; from version 2 on
///                   u16 size of this extended header (12), u16 and u32 sizes of the metadata header and of
///                   the metadata, u32 number | content | metadata header: u16 count; for each entry u16 key
///                   size, u16 encoding, u32 value size | metadata
///
/// A pose is 12 float32, the columns of a matrix, or 7: position and quaternion (x y z w). TDATA and QTDATA
/// contain several, each after its name (char[20]), a type and a zero. PLUS reports in the metadata whether a
/// tool was seen ("TransformStatus"; for TDATA its name and "Status"), and before version 2 of the protocol
/// by an identity matrix.
namespace palpate::igtl {

inline constexpr std::size_t kHeader_bytes = 58, kType_bytes = 12, kName_bytes = 20;

/// Pose of a tool, or the report that it was not seen.
struct PoseMessage {
  std::string name;         ///< Raw bytes
  bool is_tracked = false;  ///< Whether the tracker had the tool in view. If false, the pose is invalid
  std::uint64_t stamp = 0;  ///< Server time in 2^-32 s; 0: none
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
};

/// Header of a message.
struct MessageHeader {
  unsigned version = 1;
  std::string type, name;   ///< Raw bytes up to the first zero
  std::uint64_t stamp = 0;  ///< As in PoseMessage
  std::uint64_t crc = 0;    ///< Checksum of the body
};

/// Splits a stream, which arrives in pieces of any size, into messages. Bodies that are not wanted are
/// skipped without buffering, so memory stays below 64 KiB.
class MessageSplitter {
 public:
  /// Whether the bodies of messages of a type are buffered.
  using WantsBody = bool (*)(const std::string& type);
  /// Receives each complete message; the body of a type that is not wanted is empty.
  using OnMessage = std::function<void(const MessageHeader&, std::span<const std::uint8_t> body)>;

  explicit MessageSplitter(WantsBody wants_body) : wants_body_(wants_body) {}
  /// Errors: kBadInput if the input is not OpenIGTLink; the splitter is then unusable.
  Result<void> consume(std::span<const std::uint8_t> bytes, const OnMessage& on_message);

 private:
  Result<void> begin_body();

  WantsBody wants_body_;
  std::vector<std::uint8_t> header_bytes_, body_;
  MessageHeader header_;
  std::uint64_t missing_ = 0;  // remaining bytes of the body
  bool is_in_body_ = false, is_buffered_ = false;
};

/// Decodes the poses in a stream.
class PoseReader {
 public:
  using OnPose = std::function<void(const PoseMessage&)>;

  PoseReader();
  /// Errors: kBadInput if the input is not OpenIGTLink; the reader is then unusable.
  Result<void> consume(std::span<const std::uint8_t> bytes, const OnPose& on_pose);
  /// Number of pose messages that were dropped because of a wrong checksum or length.
  std::uint64_t damaged() const { return damaged_; }

 private:
  void decode(const MessageHeader& header, std::span<const std::uint8_t> body, const OnPose& on_pose);

  MessageSplitter messages_;
  std::uint64_t damaged_ = 0;
};

/// CRC-64 (ECMA 182) as the protocol uses it.
std::uint64_t crc64(std::span<const std::uint8_t> bytes);

}  // namespace palpate::igtl
