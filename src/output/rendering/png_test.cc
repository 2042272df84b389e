#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <png.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <set>
#include <string>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

std::vector<std::uint8_t> decode(const std::vector<std::uint8_t>& bytes, std::uint32_t format, int width,
                                 int height) {
  png_image header{};
  header.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_memory(&header, bytes.data(), bytes.size())) << header.message;
  EXPECT_EQ(static_cast<int>(header.width), width);
  EXPECT_EQ(static_cast<int>(header.height), height);
  header.format = format;
  std::vector<std::uint8_t> pixels(PNG_IMAGE_SIZE(header));
  EXPECT_TRUE(png_image_finish_read(&header, nullptr, pixels.data(), 0, nullptr)) << header.message;
  return pixels;
}

/// Names of a PNG's chunks.
std::set<std::string> chunks(const std::vector<std::uint8_t>& bytes) {
  std::set<std::string> names;
  for (std::size_t at = 8; at + 12 <= bytes.size();) {
    const std::size_t length = (std::size_t{bytes[at]} << 24) | (std::size_t{bytes[at + 1]} << 16) |
                               (std::size_t{bytes[at + 2]} << 8) | bytes[at + 3];
    names.emplace(bytes.begin() + static_cast<std::ptrdiff_t>(at) + 4,
                  bytes.begin() + static_cast<std::ptrdiff_t>(at) + 8);
    at += 12 + length;
  }
  return names;
}

/// Image with at most `colours` different colours.
Image speckled(int width, int height, unsigned colours) {
  std::mt19937 random(colours);
  Image image{width, height, {}};
  for (int i = 0; i < width * height; ++i) {
    const auto colour = static_cast<unsigned>(random() % colours);
    image.rgb.push_back(static_cast<std::uint8_t>(colour));
    image.rgb.push_back(static_cast<std::uint8_t>(colour >> 4));
    image.rgb.push_back(static_cast<std::uint8_t>(37 * colour));
  }
  return image;
}

TEST(Png, PicturesComeBackPixelForPixel) {
  for (const unsigned colours : {1u, 2u, 256u, 257u, 4000u}) {
    const Image image = speckled(67, 43, colours);
    EXPECT_EQ(decode(encode_png(image), PNG_FORMAT_RGB, 67, 43), image.rgb) << colours << " colours";
  }
  const Image one{1, 1, {9, 8, 7}};
  EXPECT_EQ(decode(encode_png(one), PNG_FORMAT_RGB, 1, 1), one.rgb);
}

TEST(Png, OverlaysComeBackPixelForPixel) {
  std::mt19937 random(1);
  for (const unsigned colours : {3u, 256u, 3000u}) {
    Overlay overlay{40, 31, {}};
    for (int i = 0; i < 40 * 31; ++i) {
      const auto colour = static_cast<unsigned>(random() % colours);
      for (const unsigned channel : {colour, colour >> 3, 5 * colour, colour >> 1}) {
        overlay.rgba.push_back(static_cast<std::uint8_t>(channel));
      }
    }
    EXPECT_EQ(decode(encode_png(overlay), PNG_FORMAT_RGBA, 40, 31), overlay.rgba) << colours << " colours";
  }
}

TEST(Png, GreyAndFewColoursAreSmaller) {
  Image grey = speckled(128, 128, 4000);
  for (std::size_t i = 0; i < grey.rgb.size(); i += 3) grey.rgb[i + 1] = grey.rgb[i + 2] = grey.rgb[i];
  EXPECT_EQ(decode(encode_png(grey), PNG_FORMAT_RGB, 128, 128), grey.rgb);
  EXPECT_LT(encode_png(grey).size(), 128u * 128 + 1000);
  EXPECT_LT(encode_png(speckled(128, 128, 200)).size(), 128u * 128 + 2000);
}

TEST(Png, HoldsNoTextAndNoTime) {
  for (const unsigned colours : {100u, 4000u}) {
    const std::vector<std::uint8_t> bytes = encode_png(speckled(50, 50, colours));
    EXPECT_THAT(chunks(bytes),
                ::testing::IsSubsetOf({"IHDR", "PLTE", "tRNS", "sRGB", "gAMA", "cHRM", "IDAT", "IEND"}));
    EXPECT_TRUE(chunks(bytes).contains("IEND"));
  }
}

TEST(Png, WritesAFileOrReportsTheReason) {
  const auto folder = std::filesystem::path(::testing::TempDir()) / "palpate_png_test";
  std::filesystem::create_directories(folder);
  const Image image = speckled(12, 10, 50);
  ASSERT_TRUE(write_png(folder / "a.png", image).ok());
  std::ifstream stream(folder / "a.png", std::ios::binary);
  const std::vector<char> bytes{std::istreambuf_iterator<char>(stream), {}};
  EXPECT_EQ(decode({bytes.begin(), bytes.end()}, PNG_FORMAT_RGB, 12, 10), image.rgb);

  const auto failed = write_png(folder / "absent" / "a.png", image);
  ASSERT_FALSE(failed.ok());
  EXPECT_EQ(failed.error().kind, ErrorKind::kOutput);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace palpate
