#include "volume_io/image/image.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>

#include "volume_io/image/test_images.h"

/// Images of every kind, written and read back, and damaged ones.
namespace palpate::volume_io {
namespace {

using test::Picture;
using test::PngKind;
using test::TiffLayout;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

Result<std::vector<std::uint32_t>> pixels_of(const std::string& bytes, std::size_t page = 0) {
  const auto decoder = open_image(bytes_in_memory(bytes));
  if (!decoder) return decoder.error();
  std::vector<std::uint32_t> pixels((*decoder)->pages()[page].pixels());
  if (const auto read = (*decoder)->read(page, pixels); !read) return read.error();
  return pixels;
}

void expect_pixels(const std::string& bytes, const Picture& picture, std::size_t page = 0) {
  const auto pixels = pixels_of(bytes, page);
  ASSERT_TRUE(pixels) << pixels.error().message();
  EXPECT_EQ(*pixels, picture.pixels);
}

TEST(Image, PngOfEveryKind) {
  const auto grey = test::some_picture(256), deep = test::some_picture(65536),
             nibbles = test::some_picture(16);
  expect_pixels(test::png_of(grey, PngKind::kGrey8), grey);
  expect_pixels(test::png_of(grey, PngKind::kGreyAlpha), grey);
  expect_pixels(test::png_of(grey, PngKind::kInterlaced), grey);
  expect_pixels(test::png_of(deep, PngKind::kGrey16), deep);
  expect_pixels(test::png_of(nibbles, PngKind::kGrey4), nibbles);
  Picture colours = test::some_picture(1 << 24);
  colours.pixels[3] = 0;
  for (const PngKind kind : {PngKind::kRgb, PngKind::kRgba, PngKind::kPalette}) {
    expect_pixels(test::png_of(colours, kind), colours);
    EXPECT_TRUE((*open_image(bytes_in_memory(test::png_of(colours, kind))))->pages()[0].colour);
  }
}

TEST(Image, JpegIsNear) {
  Picture smooth{16, 16, {}}, colours{16, 16, {}};
  for (std::uint32_t n = 0; n < 256; ++n) {
    smooth.pixels.push_back(n);
    colours.pixels.push_back(0xC08040);
  }
  const auto grey = pixels_of(test::jpeg_of(smooth, false)), colour = pixels_of(test::jpeg_of(colours, true));
  ASSERT_TRUE(grey) << grey.error().message();
  ASSERT_TRUE(colour) << colour.error().message();
  for (std::size_t n = 0; n < 256; ++n) {
    EXPECT_NEAR((*grey)[n], smooth.pixels[n], 3);
    for (const int shift : {0, 8, 16})
      EXPECT_NEAR((*colour)[n] >> shift & 0xFF, colours.pixels[n] >> shift & 0xFF, 3);
  }
}

TEST(Image, TiffOfEveryLayout) {
  std::size_t layouts = 0;
  for (const auto packing : {TiffLayout::Packing::kNone, TiffLayout::Packing::kLzw,
                             TiffLayout::Packing::kDeflate, TiffLayout::Packing::kPackBits})
    for (const bool big_endian : {false, true})
      for (const bool big_tiff : {false, true})
        for (const bool tiled : {false, true})
          for (const int bits : {1, 4, 8, 16})
            for (const bool predicted : {false, true}) {
              const bool packs =
                  packing == TiffLayout::Packing::kLzw || packing == TiffLayout::Packing::kDeflate;
              if (predicted && (bits < 8 || !packs)) continue;
              TiffLayout layout{packing, big_endian, big_tiff, tiled};
              layout.predicted = predicted;
              layout.bits = bits;
              layout.white_is_zero = layouts % 3 == 0;
              SCOPED_TRACE(layouts++);
              const auto one = test::some_picture(1u << bits, 1, 37, 21),
                         two = test::some_picture(1u << bits, 2, 37, 21);
              const std::string bytes = test::tiff_of({one, two}, layout);
              expect_pixels(bytes, one, 0);
              expect_pixels(bytes, two, 1);
            }
  EXPECT_EQ(layouts, 160u);
}

TEST(Image, TiffInColours) {
  const auto colours = test::some_picture(1 << 24, 3, 20, 11);
  for (const bool separate : {false, true})
    for (const int bits : {8, 16})
      for (const bool tiled : {false, true}) {
        TiffLayout layout;
        layout.colour = true;
        layout.separate = separate;
        layout.bits = bits;
        layout.tiled = tiled;
        expect_pixels(test::tiff_of({colours}, layout), colours);
      }
  TiffLayout palette;
  palette.palette = true;
  palette.bits = 4;
  auto indices = test::some_picture(16, 4);
  const std::string bytes = test::tiff_of({indices}, palette);
  for (std::uint32_t& pixel : indices.pixels)
    if (pixel != 0) pixel = (pixel * 16) << 16 | (pixel * 16 + 1) << 8 | (pixel * 16 + 2);
  expect_pixels(bytes, indices);
}

TEST(Image, TiffOfFloats) {
  Picture picture{5, 4, {}};
  for (int n = 0; n < 20; ++n)
    picture.pixels.push_back(std::bit_cast<std::uint32_t>(0.37f * static_cast<float>(n)));
  TiffLayout layout;
  layout.is_float = true;
  layout.bits = 32;
  expect_pixels(test::tiff_of({picture}, layout), picture);
  EXPECT_EQ((*open_image(bytes_in_memory(test::tiff_of({picture}, layout))))->pages()[0].component,
            Component::kFloat32);
}

// all code widths, and a full table
TEST(Image, LzwOfALongStrip) {
  const auto noise = test::some_picture(65536, 9, 300, 100);
  TiffLayout layout;
  layout.packing = TiffLayout::Packing::kLzw;
  layout.bits = 16;
  layout.rows_per_strip = 100;
  expect_pixels(test::tiff_of({noise}, layout), noise);
  Picture flat{300, 300, std::vector<std::uint32_t>(90000, 7)};
  layout.rows_per_strip = 300;
  expect_pixels(test::tiff_of({flat}, layout), flat);
}

TEST(Image, RejectsLargeImagesBeforeAllocating) {
  std::string bytes = test::png_of(test::some_picture(256), PngKind::kGrey8);
  for (const std::size_t at : {16u, 20u}) bytes.replace(at, 4, std::string("\x00\x01\x00\x00", 4));
  const auto large = pixels_of(bytes);
  ASSERT_FALSE(large);
  EXPECT_THAT(large.error().what, HasSubstr("65536 x 65536 pixels"));
  EXPECT_THAT(large.error().remedy, HasSubstr("crop or scale"));
}

TEST(Image, PackingsThatAreNotReadAreNamed) {
  std::string bytes = test::tiff_of({test::some_picture(256)}, {});
  // CCITT group 4 instead of no compression
  const auto at = bytes.find(std::string("\x03\x01\x03\x00\x01\x00\x00\x00\x01\x00", 10));
  ASSERT_NE(at, std::string::npos);
  bytes[at + 8] = 4;
  const auto refused = pixels_of(bytes);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().what, HasSubstr("Compression 4"));
  EXPECT_THAT(refused.error().remedy, HasSubstr("tiffcp -c none"));
}

// 300 truncations and 300 bit flips of each kind: an error or some pixels
TEST(Image, DamageIsRefusedOrReadAndNothingElse) {
  const auto grey = test::some_picture(256, 5, 20, 12);
  TiffLayout lzw, deflated, big;
  lzw.packing = TiffLayout::Packing::kLzw;
  lzw.predicted = true;
  deflated.packing = TiffLayout::Packing::kDeflate;
  deflated.tiled = true;
  big.packing = TiffLayout::Packing::kPackBits;
  big.big_tiff = big.big_endian = true;
  const std::vector<std::string> whole{
      test::png_of(grey, PngKind::kGrey8), test::png_of(test::some_picture(1 << 24), PngKind::kPalette),
      test::jpeg_of(grey, false),          test::jpeg_of(test::some_picture(1 << 24, 1, 20, 12), true),
      test::tiff_of({grey, grey}, lzw),    test::tiff_of({grey}, deflated),
      test::tiff_of({grey}, big)};
  std::mt19937 random(7);
  for (std::size_t kind = 0; kind < whole.size(); ++kind) {
    SCOPED_TRACE(kind);
    std::size_t refused = 0;
    const auto look = [&](const std::string& bytes) {
      const auto pixels = pixels_of(bytes);
      if (pixels) return;
      ++refused;
      EXPECT_THAT(pixels.error().what, Not(IsEmpty()));
      EXPECT_THAT(pixels.error().remedy, Not(IsEmpty()));
    };
    for (int n = 0; n < 300; ++n) look(whole[kind].substr(0, random() % whole[kind].size()));
    EXPECT_GT(refused, 250u) << "a picture that is cut short is not whole";
    for (int n = 0; n < 300; ++n) {
      std::string bytes = whole[kind];
      bytes[random() % bytes.size()] ^= static_cast<char>(1 << random() % 8);
      look(bytes);
    }
  }
}

}  // namespace
}  // namespace palpate::volume_io
