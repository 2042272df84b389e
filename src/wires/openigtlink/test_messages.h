#pragma once

#include <Eigen/Geometry>
#include <bit>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "palpate/openigtlink/messages.h"

/// Messages as a tracker's server writes them.
namespace palpate::test {

using MessageBytes = std::vector<std::uint8_t>;

inline void append_integer(MessageBytes& out, std::size_t bytes, std::uint64_t value) {
  for (std::size_t n = bytes; n-- > 0;) out.push_back(static_cast<std::uint8_t>(value >> (8 * n)));
}
inline void append_real(MessageBytes& out, double value) {
  append_integer(out, 4, std::bit_cast<std::uint32_t>(static_cast<float>(value)));
}
inline void put_text(MessageBytes& out, const std::string& text, std::size_t bytes) {
  for (std::size_t n = 0; n < bytes; ++n)
    out.push_back(static_cast<std::uint8_t>(n < text.size() ? text[n] : 0));
}
inline MessageBytes matrix_bytes(const Eigen::Isometry3d& pose) {
  MessageBytes out;
  for (int c = 0; c < 4; ++c)
    for (int r = 0; r < 3; ++r) append_real(out, pose.matrix()(r, c));
  return out;
}
inline MessageBytes quaternion_bytes(const Eigen::Isometry3d& pose) {
  MessageBytes out;
  const Eigen::Quaterniond turn(pose.linear());
  for (int k = 0; k < 3; ++k) append_real(out, pose.translation()[k]);
  for (const double number : {turn.x(), turn.y(), turn.z(), turn.w()}) append_real(out, number);
  return out;
}
/// Element of TDATA and QTDATA.
inline MessageBytes element_bytes(const std::string& name, const MessageBytes& pose) {
  MessageBytes out;
  put_text(out, name, 20);
  append_integer(out, 2, 0x0200);
  out.insert(out.end(), pose.begin(), pose.end());
  return out;
}

using MessageWords = std::vector<std::pair<std::string, std::string>>;

/// Message of version 1 without metadata, otherwise of version 2.
inline MessageBytes message_bytes(const std::string& type, const std::string& name,
                                  const MessageBytes& content, const MessageWords* words = nullptr,
                                  std::uint64_t stamp = 0) {
  MessageBytes body;
  if (words != nullptr) {
    MessageBytes heads, texts;
    append_integer(heads, 2, words->size());
    for (const auto& [key, value] : *words) {
      append_integer(heads, 2, key.size());
      append_integer(heads, 2, 3);
      append_integer(heads, 4, value.size());
      put_text(texts, key, key.size());
      put_text(texts, value, value.size());
    }
    append_integer(body, 2, 12);
    append_integer(body, 2, heads.size());
    append_integer(body, 4, texts.size());
    append_integer(body, 4, 0);
    for (const MessageBytes& part : {content, heads, texts})
      body.insert(body.end(), part.begin(), part.end());
  } else {
    body = content;
  }
  MessageBytes out;
  append_integer(out, 2, words != nullptr ? 2 : 1);
  put_text(out, type, 12);
  put_text(out, name, 20);
  append_integer(out, 8, stamp);
  append_integer(out, 8, body.size());
  append_integer(out, 8, igtl::crc64(body));
  out.insert(out.end(), body.begin(), body.end());
  return out;
}
inline MessageBytes transform_message(const std::string& name, const Eigen::Isometry3d& pose,
                                      std::uint64_t stamp = 0) {
  return message_bytes("TRANSFORM", name, matrix_bytes(pose), nullptr, stamp);
}

}  // namespace palpate::test
