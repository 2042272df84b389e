#include "tracker/messages.h"

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
constexpr double kFarthest_mm = 10'000;
constexpr std::size_t kTypeAt = 2, kNameAt = 14, kStampAt = 34, kBodyAt = 42, kCrcAt = 50;
constexpr std::size_t kType_bytes = 12, kName_bytes = 20, kMatrix_bytes = 48, kQuaternion_bytes = 28;
// name, type and a zero
constexpr std::size_t kElementHead_bytes = kName_bytes + 2;

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

std::uint64_t whole(Bytes bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t n = 0; n < count; ++n) value = value << 8 | bytes[at + n];
  return value;
}
double real32(Bytes bytes, std::size_t at) {
  return std::bit_cast<float>(static_cast<std::uint32_t>(whole(bytes, at, 4)));
}
// up to the first zero
std::string text(Bytes bytes) {
  const auto end = std::find(bytes.begin(), bytes.end(), std::uint8_t{0});
  return {bytes.begin(), end};
}

bool is_pose(const std::string& type) {
  return type == "TRANSFORM" || type == "POSITION" || type == "TDATA" || type == "QTDATA";
}

using Words = std::map<std::string, std::string>;

struct Content {
  Bytes poses;
  Words words;
};

// metadata of version 2 and later; empty: inconsistent lengths
std::optional<Words> words_of(Bytes heads, Bytes words) {
  Words out;
  if (heads.empty()) return out;
  if (heads.size() < 2) return {};
  const std::size_t count = whole(heads, 0, 2);
  if (heads.size() < 2 + 8 * count) return {};
  for (std::size_t n = 0, from = 0; n < count; ++n) {
    const std::size_t key = whole(heads, 2 + 8 * n, 2), value = whole(heads, 6 + 8 * n, 4);
    if (key > words.size() - from || value > words.size() - from - key) return {};
    const Bytes key_bytes = words.subspan(from, key), value_bytes = words.subspan(from + key, value);
    out.emplace(text(key_bytes), text(value_bytes));
    from += key + value;
  }
  return out;
}
std::optional<Content> content_of(unsigned version, Bytes body) {
  if (version == 1) return Content{body, {}};
  if (body.size() < 12) return {};
  const std::size_t head = whole(body, 0, 2), words_head = whole(body, 2, 2), words = whole(body, 4, 4);
  if (head < 12 || head > body.size() || words_head > body.size() - head ||
      words > body.size() - head - words_head)
    return {};
  const std::size_t content = body.size() - head - words_head - words;
  auto found = words_of(body.subspan(head + content, words_head), body.last(words));
  if (!found) return {};
  return Content{body.subspan(head, content), *std::move(found)};
}

// servers send the identity in place of a missing pose
void take_pose(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& at_mm, PoseMessage& out) {
  const bool is_rigid = rotation.allFinite() && at_mm.allFinite() && at_mm.norm() < kFarthest_mm &&
                        (rotation * rotation.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-3 &&
                        rotation.determinant() > 0;
  out.seen = is_rigid && !(rotation.isIdentity(0) && at_mm.isZero(0));
  if (!out.seen) return;
  // orthonormalised, since float32 is inexact
  out.rotation = Eigen::Quaterniond(rotation).normalized().toRotationMatrix();
  out.at_mm = at_mm;
}
void take_matrix(Bytes bytes, PoseMessage& out) {
  Eigen::Matrix<double, 3, 4> columns;
  for (std::size_t n = 0; n < 12; ++n)
    columns(static_cast<int>(n % 3), static_cast<int>(n / 3)) = real32(bytes, 4 * n);
  take_pose(columns.leftCols<3>(), columns.col(3), out);
}
void take_quaternion(Bytes bytes, PoseMessage& out) {
  const auto number = [&](std::size_t n) { return real32(bytes, 4 * n); };
  const Eigen::Quaterniond turn(number(6), number(3), number(4), number(5));
  const double length = turn.norm();
  // rejects quaternions whose norm is not 1
  take_pose(length > 0.99 && length < 1.01 ? turn.normalized().toRotationMatrix() : Eigen::Matrix3d::Zero(),
            {number(0), number(1), number(2)}, out);
}

// status according to PLUS; without a status a pose is valid
bool is_said_to_be_seen(const Words& words, const std::string& key) {
  const auto found = words.find(key);
  return found == words.end() || found->second == "OK";
}

}  // namespace

std::uint64_t crc64(Bytes bytes) {
  static constexpr auto kTable = crc_table();
  std::uint64_t crc = 0;
  for (const std::uint8_t byte : bytes) crc = kTable[crc >> 56 ^ byte] ^ crc << 8;
  return crc;
}

Result<void> Reader::take(Bytes bytes, const Told& told) {
  while (!bytes.empty()) {
    if (!is_in_body_) {
      const std::size_t some = std::min(bytes.size(), kHead_bytes - head_.size());
      head_.insert(head_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(some));
      bytes = bytes.subspan(some);
      if (head_.size() < kHead_bytes) return {};
      if (auto begun = begin_body(); !begun) return begun;
    }
    const std::size_t some = std::min<std::uint64_t>(bytes.size(), missing_);
    if (is_kept_) body_.insert(body_.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(some));
    bytes = bytes.subspan(some);
    missing_ -= some;
    if (missing_ == 0) end_body(told);
  }
  return {};
}

Result<void> Reader::begin_body() {
  const std::uint64_t version = whole(head_, 0, 2);
  missing_ = whole(head_, kBodyAt, 8);
  const std::string type = text(Bytes(head_).subspan(kTypeAt, kType_bytes));
  const bool is_type = !type.empty() && std::all_of(type.begin(), type.end(), [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
  });
  is_kept_ = is_pose(type);
  const bool is_image = type == "IMAGE" || type == "VIDEO" || type == "NDARRAY" || type == "POLYDATA";
  // bounds the length, since a wrong one would swallow the following poses
  const std::uint64_t max_bytes = is_kept_ ? kMaxBody_bytes : is_image ? kMaxImage_bytes : kMaxOther_bytes;
  if (version < 1 || version > 3 || !is_type || missing_ > max_bytes)
    return Error{ErrorKind::kBadInput, "does not send OpenIGTLink messages", "",
                 "check that the address is that of a tracking server (PLUS: port 18944)"};
  is_in_body_ = true;
  return {};
}

void Reader::end_body(const Told& told) {
  const std::vector<std::uint8_t> head = std::exchange(head_, {}), body = std::exchange(body_, {});
  is_in_body_ = false;
  if (!is_kept_) return;
  const auto content = crc64(body) == whole(head, kCrcAt, 8)
                           ? content_of(static_cast<unsigned>(whole(head, 0, 2)), body)
                           : std::nullopt;
  if (!content) {
    ++damaged_;
    return;
  }
  const std::string type = text(Bytes(head).subspan(kTypeAt, kType_bytes));
  const bool has_matrix = type == "TRANSFORM" || type == "TDATA";
  const std::size_t pose_bytes = has_matrix ? kMatrix_bytes : kQuaternion_bytes;
  const auto take_numbers = has_matrix ? take_matrix : take_quaternion;
  PoseMessage message;
  message.stamp = whole(head, kStampAt, 8);

  // a single pose, under the message's own name
  if (type == "TRANSFORM" || type == "POSITION") {
    if (content->poses.size() != pose_bytes) {
      ++damaged_;
      return;
    }
    message.name = text(Bytes(head).subspan(kNameAt, kName_bytes));
    if (const auto whole_name = content->words.find("IGTL_DEVICE_NAME"); whole_name != content->words.end())
      message.name = whole_name->second;
    take_numbers(content->poses, message);
    message.seen = message.seen && is_said_to_be_seen(content->words, "TransformStatus");
    return told(message);
  }

  // several poses, each under its own name
  const std::size_t element = kElementHead_bytes + pose_bytes;
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
      for (const auto& [word, value] : content->words)
        if (word.ends_with(kStatus) && word.size() > key.size() && word.starts_with(message.name)) {
          key = word;
          message.name = word.substr(0, word.size() - kStatus.size());
        }
    take_numbers(one.subspan(kElementHead_bytes), message);
    message.seen = message.seen && is_said_to_be_seen(content->words, key);
    told(message);
  }
}

std::vector<std::uint8_t> greeting() {
  // extended head, then code 1 (OK) without sub-code, name or text
  constexpr std::size_t kHead = 12, kContent = 2 + 8 + 20 + 1, kWordsHead = 2;
  std::vector<std::uint8_t> bytes(kHead_bytes + kHead + kContent + kWordsHead, 0);
  const auto put = [&](std::size_t at, std::size_t count, std::uint64_t value) {
    for (std::size_t n = count; n-- > 0; value >>= 8) bytes[at + n] = static_cast<std::uint8_t>(value);
  };
  const auto put_text = [&](std::size_t at, std::string_view words) {
    std::copy(words.begin(), words.end(), bytes.begin() + static_cast<std::ptrdiff_t>(at));
  };
  put(0, 2, 2);
  put_text(kTypeAt, "STATUS");
  put_text(kNameAt, "palpate");
  put(kBodyAt, 8, bytes.size() - kHead_bytes);
  put(kHead_bytes, 2, kHead);
  put(kHead_bytes + 2, 2, kWordsHead);
  put(kHead_bytes + kHead, 2, 1);
  put(kCrcAt, 8, crc64(Bytes(bytes).subspan(kHead_bytes)));
  return bytes;
}

}  // namespace palpate::igtl
