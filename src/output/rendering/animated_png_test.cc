#include "palpate/rendering/animated_png.h"

#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <random>
#include <string>

#include "base/test_seed.h"

namespace palpate {
namespace {

using Bytes = std::vector<std::uint8_t>;

std::uint32_t number_at(const Bytes& bytes, std::size_t at) {
  return std::uint32_t{bytes[at]} << 24 | std::uint32_t{bytes[at + 1]} << 16 |
         std::uint32_t{bytes[at + 2]} << 8 | bytes[at + 3];
}

struct Chunk {
  std::string type;
  Bytes data;
};

std::vector<Chunk> chunks_of(const Bytes& png) {
  std::vector<Chunk> chunks;
  for (std::size_t at = 8; at + 12 <= png.size();) {
    const std::size_t size = number_at(png, at);
    const auto data = png.begin() + static_cast<std::ptrdiff_t>(at + 8);
    chunks.push_back({std::string(png.begin() + static_cast<std::ptrdiff_t>(at + 4), data),
                      Bytes(data, data + static_cast<std::ptrdiff_t>(size))});
    at += size + 12;
  }
  return chunks;
}

/// Decodes by libpng, which verifies checksums and filters.
Image read_still(const Bytes& png) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  Image image;
  if (png_image_begin_read_from_memory(&header, png.data(), png.size()) == 0) return image;
  header.format = PNG_FORMAT_RGB;
  image = {static_cast<int>(header.width), static_cast<int>(header.height), Bytes(PNG_IMAGE_SIZE(header))};
  EXPECT_NE(png_image_finish_read(&header, nullptr, image.rgb.data(), 0, nullptr), 0) << header.message;
  return image;
}

/// Frame's box as a still PNG with the chunks that such a file has.
Bytes still_of(std::uint32_t width, std::uint32_t height, const Bytes& data) {
  // an encoded picture of that size with replaced image data: header and end stay
  Bytes png{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  const auto add = [&](const char* type, const Bytes& content) {
    const auto number = [&](std::uint32_t value) {
      for (int n = 3; n >= 0; --n) png.push_back(static_cast<std::uint8_t>(value >> (8 * n)));
    };
    number(static_cast<std::uint32_t>(content.size()));
    Bytes body(type, type + 4);
    body.insert(body.end(), content.begin(), content.end());
    std::uint32_t sum = 0xffffffff;
    for (const std::uint8_t byte : body) {
      sum ^= byte;
      for (int bit = 0; bit < 8; ++bit) sum = (sum & 1) != 0 ? sum >> 1 ^ 0xedb88320u : sum >> 1;
    }
    png.insert(png.end(), body.begin(), body.end());
    number(~sum);
  };
  Bytes header;
  for (const std::uint32_t value : {width, height})
    for (int n = 3; n >= 0; --n) header.push_back(static_cast<std::uint8_t>(value >> (8 * n)));
  header.insert(header.end(), {8, 2, 0, 0, 0});
  add("IHDR", header);
  add("IDAT", data);
  add("IEND", {});
  return png;
}

TEST(AnimatedPng, PlaysTheFramesThatWereAdded) {
  const unsigned seed = test::test_seed();
  std::printf("seed %u\n", seed);
  std::mt19937 random(seed);
  for (const auto& [width, height] : {std::pair{1, 1}, std::pair{37, 23}, std::pair{64, 5}}) {
    constexpr int kFrames = 5;
    std::vector<Image> frames;
    for (int n = 0; n < kFrames; ++n) {
      Image frame = n == 0 ? Image{width, height, Bytes(3ul * width * height, 20)} : frames.back();
      // no change in the third frame
      if (n != 2)
        for (int m = 0; m < 40; ++m)
          frame.rgb[random() % frame.rgb.size()] = static_cast<std::uint8_t>(random());
      frames.push_back(frame);
    }
    AnimatedPng animated(width, height, kFrames, 40);
    for (const Image& frame : frames) animated.add(frame);
    const Bytes png = animated.finish();
    EXPECT_EQ(read_still(png).rgb, frames[0].rgb);

    const std::vector<Chunk> chunks = chunks_of(png);
    ASSERT_EQ(chunks.size(), 4u + 2 * kFrames);
    EXPECT_EQ(chunks[0].type, "IHDR");
    EXPECT_EQ(chunks[1].type, "sRGB");
    EXPECT_EQ(chunks[2].type, "acTL");
    EXPECT_EQ(number_at(chunks[2].data, 0), std::uint32_t{kFrames});
    EXPECT_EQ(chunks.back().type, "IEND");
    std::uint32_t sequence = 0;
    Image shown;
    for (std::size_t n = 0; n < kFrames; ++n) {
      const Chunk &control = chunks[3 + 2 * n], &data = chunks[4 + 2 * n];
      ASSERT_EQ(control.type, "fcTL");
      ASSERT_EQ(control.data.size(), 26u);
      EXPECT_EQ(number_at(control.data, 0), sequence++);
      EXPECT_EQ(number_at(control.data, 20), 40u << 16 | 1000u);
      const std::uint32_t w = number_at(control.data, 4), h = number_at(control.data, 8),
                          left = number_at(control.data, 12), top = number_at(control.data, 16);
      ASSERT_LE(left + w, static_cast<std::uint32_t>(width));
      ASSERT_LE(top + h, static_cast<std::uint32_t>(height));
      ASSERT_EQ(data.type, n == 0 ? "IDAT" : "fdAT");
      if (n > 0) {
        EXPECT_EQ(number_at(data.data, 0), sequence++);
      }
      const Image box =
          read_still(still_of(w, h, Bytes(data.data.begin() + (n > 0 ? 4 : 0), data.data.end())));
      ASSERT_EQ(box.rgb.size(), 3ul * w * h);
      if (n == 0) shown = {width, height, Bytes(3ul * width * height)};
      for (std::uint32_t row = 0; row < h; ++row)
        std::copy_n(&box.rgb[3ul * w * row], 3ul * w,
                    &shown.rgb[3ul * ((top + row) * static_cast<std::uint32_t>(width) + left)]);
      EXPECT_EQ(shown.rgb, frames[n].rgb) << n;
    }
  }
}

/// Animated and still pictures declare the same colour space.
TEST(AnimatedPng, DeclaresColoursLikeAStillImage) {
  std::mt19937 random(1);
  Image image{20, 20, Bytes(1200)};
  for (std::uint8_t& value : image.rgb) value = static_cast<std::uint8_t>(random());
  AnimatedPng animated(20, 20, 1, 50);
  animated.add(image);
  const auto colours = [](const Bytes& png) {
    Bytes declared;
    for (const Chunk& chunk : chunks_of(png))
      if (chunk.type == "sRGB") declared = chunk.data;
    return declared;
  };
  EXPECT_EQ(colours(encode_png(image)), Bytes{0});
  EXPECT_EQ(colours(animated.finish()), Bytes{0});
}

TEST(AnimatedPng, IsTheSameEachTime) {
  const auto made = [] {
    AnimatedPng animated(8, 4, 2, 50);
    animated.add({8, 4, Bytes(96, 7)});
    animated.add({8, 4, Bytes(96, 9)});
    return animated.finish();
  };
  EXPECT_EQ(made(), made());
}

}  // namespace
}  // namespace palpate
