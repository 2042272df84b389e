#include "palpate/openigtlink/messages.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <map>
#include <optional>
#include <string_view>

namespace palpate::igtl {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::size_t kMaxBody_bytes = std::size_t{1} << 16;
// maximum size of skipped bodies: images of volumes, and everything else
constexpr std::uint64_t kMaxImage_bytes = std::uint64_t{1} << 28, kMaxOther_bytes = std::uint64_t{1} << 24;
// beyond the range of any tracking system
constexpr double kMaxPosition_mm = 10'000;
constexpr std::size_t kTypeAt = 2, kNameAt = 14, kStampAt = 34, kBodyAt = 42, kCrcAt = 50;
constexpr std::size_t kMatrix_bytes = 48, kQuaternion_bytes = 28;
// name, type and a zero
constexpr std::size_t kElementHeader_bytes = kName_bytes + 2;

constexpr std::array<std::uint64_t, 256> crc_table() {
  constexpr std::uint64_t kPolynomial = 0x42F0E1EBA9EA3693;
  std::array<std::uint64_t, 256> table{};
  for (std::uint64_t byte = 0; byte < 256; ++byte) {
    std::uint64_t rest = byte << 56;
    for (int bit = 0; bit < 8; ++bit) rest = (rest >> 63) != 0 ? rest << 1 ^ kPolynomial : rest << 1;
    table[byte] = rest;
  }
  return table;
}

std::uint64_t read_uint(Bytes bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t n = 0; n < count; ++n) value = value << 8 | bytes[at + n];
  return value;
}
double real32(Bytes bytes, std::size_t at) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(read_uint(bytes, at, 4)));
}
// up to the first zero
std::string text(Bytes bytes) {
  const auto end = std::find(bytes.begin(), bytes.end(), std::uint8_t{0});
  return {bytes.begin(), end};
}

bool is_pose(const std::string& type) {
  return type == "TRANSFORM" || type == "POSITION" || type == "TDATA" || type == "QTDATA";
}

using Metadata = std::map<std::string, std::string>;

struct Content {
  Bytes poses;
  Metadata metadata;
};

// metadata of version 2 and later; empty: inconsistent lengths
std::optional<Metadata> parse_metadata(Bytes header, Bytes entries) {
  Metadata out;
  if (header.empty()) return out;
  if (header.size() < 2) return {};
  const std::size_t count = read_uint(header, 0, 2);
  if (header.size() < 2 + 8 * count) return {};
  for (std::size_t n = 0, from = 0; n < count; ++n) {
    const std::size_t key = read_uint(header, 2 + 8 * n, 2), value = read_uint(header, 6 + 8 * n, 4);
    if (key > entries.size() - from || value > entries.size() - from - key) return {};
    const Bytes key_bytes = entries.subspan(from, key), value_bytes = entries.subspan(from + key, value);
    out.emplace(text(key_bytes), text(value_bytes));
    from += key + value;
  }
  return out;
}
std::optional<Content> content_of(unsigned version, Bytes body) {
  if (version == 1) return Content{body, {}};
  if (body.size() < 12) return {};
  const std::size_t header_bytes = read_uint(body, 0, 2), metadata_header_bytes = read_uint(body, 2, 2),
                    metadata_bytes = read_uint(body, 4, 4);
  if (header_bytes < 12 || header_bytes > body.size() || metadata_header_bytes > body.size() - header_bytes ||
      metadata_bytes > body.size() - header_bytes - metadata_header_bytes)
    return {};
  const std::size_t content = body.size() - header_bytes - metadata_header_bytes - metadata_bytes;
  auto found =
      parse_metadata(body.subspan(header_bytes + content, metadata_header_bytes), body.last(metadata_bytes));
  if (!found) return {};
  return Content{body.subspan(header_bytes, content), *std::move(found)};
}

// servers send the identity in place of a missing pose
void receive_pose(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& at_mm, PoseMessage& out) {
  const bool is_rigid = rotation.allFinite() && at_mm.allFinite() && at_mm.norm() < kMaxPosition_mm &&
                        (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3 &&
                        rotation.determinant() > 0;
  out.is_tracked = is_rigid && !(rotation.isIdentity(0) && at_mm.isZero(0));
  if (!out.is_tracked) return;
  // orthonormalised, since float32 is inexact
  out.rotation = Eigen::Quaterniond(rotation).normalized().toRotationMatrix();
  out.at_mm = at_mm;
}
void take_matrix(Bytes bytes, PoseMessage& out) {
  Eigen::Matrix<double, 3, 4> columns;
  for (std::size_t n = 0; n < 12; ++n)
    columns(static_cast<int>(n % 3), static_cast<int>(n / 3)) = real32(bytes, 4 * n);
  receive_pose(columns.leftCols<3>(), columns.col(3), out);
}
void take_quaternion(Bytes bytes, PoseMessage& out) {
  const auto number = [&](std::size_t n) { return real32(bytes, 4 * n); };
  const Eigen::Quaterniond turn(number(6), number(3), number(4), number(5));
  const double length = turn.norm();
  // rejects quaternions whose norm is not 1
  receive_pose(
      length > 0.99 && length < 1.01 ? turn.normalized().toRotationMatrix() : Eigen::Matrix3d::Zero(),
      {number(0), number(1), number(2)}, out);
}

// status according to PLUS; without a status a pose is valid
bool is_declared_visible(const Metadata& metadata, const std::string& key) {
  const auto found = metadata.find(key);
  return found == metadata.end() || found->second == "OK";
}

}  // namespace

std::uint64_t crc64(Bytes bytes) {
  static constexpr auto kTable = crc_table();
  std::uint64_t crc = 0;
  for (const std::uint8_t byte : bytes) crc = kTable[crc >> 56 ^ byte] ^ crc << 8;
  return crc;
}

Result<void> MessageSplitter::consume(Bytes bytes, const OnMessage& on_message) {
  while (!bytes.empty()) {
    if (!is_in_body_) {
      const std::size_t some = std::min(bytes.size(), kHeader_bytes - header_bytes_.size());
      header_bytes_.insert(header_bytes_.end(), bytes.begin(),
                           bytes.begin() + static_cast<std::ptrdiff_t>(some));
      bytes = bytes.subspan(some);
      if (header_bytes_.size() < kHeader_bytes) return {};
      if (auto begun = begin_body(); !begun) return begun;
    }
    const std::size_t some = std::min<std::uint64_t>(bytes.size(), missing_);
    if (is_buffered_)
      body_.insert(body_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(some));
    bytes = bytes.subspan(some);
    missing_ -= some;
    if (missing_ > 0) return {};
    is_in_body_ = false;
    header_bytes_.clear();
    on_message(header_, std::exchange(body_, {}));
  }
  return {};
}

Result<void> MessageSplitter::begin_body() {
  const Bytes header(header_bytes_);
  header_ = {static_cast<unsigned>(read_uint(header, 0, 2)), text(header.subspan(kTypeAt, kType_bytes)),
             text(header.subspan(kNameAt, kName_bytes)), read_uint(header, kStampAt, 8),
             read_uint(header, kCrcAt, 8)};
  missing_ = read_uint(header, kBodyAt, 8);
  const std::string& type = header_.type;
  const bool is_type = !type.empty() && std::all_of(type.begin(), type.end(), [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
  is_buffered_ = wants_body_(type);
  const bool is_image = type == "IMAGE" || type == "VIDEO" || type == "NDARRAY" || type == "POLYDATA";
  // bounds the length, since a wrong one would swallow the following messages
  const std::uint64_t max_bytes = is_buffered_ ? kMaxBody_bytes
                                  : is_image   ? kMaxImage_bytes
                                               : kMaxOther_bytes;
  if (header_.version < 1 || header_.version > 3 || !is_type || missing_ > max_bytes)
    return Error{ErrorKind::kBadInput, "does not send OpenIGTLink messages", "",
                 "check that the address is that of a tracking server (PLUS: port 18944)"};
  is_in_body_ = true;
  return {};
}

PoseReader::PoseReader() : messages_(is_pose) {}

Result<void> PoseReader::consume(Bytes bytes, const OnPose& on_pose) {
  return messages_.consume(bytes, [&](const MessageHeader& header, Bytes body) {
    if (is_pose(header.type)) decode(header, body, on_pose);
  });
}

void PoseReader::decode(const MessageHeader& header, Bytes body, const OnPose& on_pose) {
  const auto content = crc64(body) == header.crc ? content_of(header.version, body) : std::nullopt;
  if (!content) {
    ++damaged_;
    return;
  }
  const bool has_matrix = header.type == "TRANSFORM" || header.type == "TDATA";
  const std::size_t pose_bytes = has_matrix ? kMatrix_bytes : kQuaternion_bytes;
  const auto take_numbers = has_matrix ? take_matrix : take_quaternion;
  PoseMessage message;
  message.stamp = header.stamp;

  // a single pose, under the message's own name
  if (header.type == "TRANSFORM" || header.type == "POSITION") {
    if (content->poses.size() != pose_bytes) {
      ++damaged_;
      return;
    }
    message.name = header.name;
    if (const auto whole_name = content->metadata.find("IGTL_DEVICE_NAME");
        whole_name != content->metadata.end())
      message.name = whole_name->second;
    take_numbers(content->poses, message);
    message.is_tracked = message.is_tracked && is_declared_visible(content->metadata, "TransformStatus");
    return on_pose(message);
  }

  // several poses, each under its own name
  const std::size_t element = kElementHeader_bytes + pose_bytes;
  if (content->poses.size() % element != 0) {
    ++damaged_;
    return;
  }
  for (std::size_t at = 0; at < content->poses.size(); at += element) {
    const Bytes one = content->poses.subspan(at, element);
    message.name = text(one.first(kName_bytes));
    // for names longer than 20 characters the metadata contain the complete name
    constexpr std::string_view kStatus = "Status";
    std::string key = message.name + std::string(kStatus);
    if (message.name.size() == kName_bytes)
      for (const auto& [word, value] : content->metadata)
        if (word.ends_with(kStatus) && word.size() > key.size() && word.starts_with(message.name)) {
          key = word;
          message.name = word.substr(0, word.size() - kStatus.size());
        }
    take_numbers(one.subspan(kElementHeader_bytes), message);
    message.is_tracked = message.is_tracked && is_declared_visible(content->metadata, key);
    on_pose(message);
  }
}

}  // namespace palpate::igtl
