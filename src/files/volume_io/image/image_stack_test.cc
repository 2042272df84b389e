#include "volume_io/image/image_stack.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "base/test_folder.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/image/test_images.h"

/// Folders of images, and multi-page images, as volumes.
namespace palpate {
namespace {

using test::Picture;
using test::PngKind;
using test::TiffLayout;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr int kPictures = 12;

class ImageStack : public ::testing::Test {
 protected:
  ImageStack() {
    set_placement_options({.image_spacing_mm = Eigen::Vector3d(0.05, 0.06, 0.2)});
    std::filesystem::create_directories(folder_ / "stack");
  }
  ~ImageStack() override { set_placement_options({}); }

  void write(const std::string& name, const std::string& bytes) {
    std::ofstream(folder_ / "stack" / name, std::ios::binary) << bytes;
  }
  // slice1.png ... slice12.png, where "10" precedes "2" alphabetically
  void write_stack(std::uint32_t end, PngKind kind) {
    for (int k = 0; k < kPictures; ++k)
      write("slice" + std::to_string(k + 1) + ".png", test::png_of(slice(end, k), kind));
  }
  static Picture slice(std::uint32_t end, int k) {
    return test::some_picture(end, static_cast<std::uint32_t>(k));
  }
  Result<ScanFile> scan() {
    return read_scan(folder_ / "stack", {}, [&](const std::string& message) { warnings_ += message + "\n"; });
  }
  Result<LabelFile> labels(const std::optional<std::filesystem::path>& names = {}) {
    return read_labels(folder_ / "stack", names, {},
                       [&](const std::string& message) { warnings_ += message + "\n"; });
  }
  void expect_scan(const Result<ScanFile>& read, std::uint32_t end) {
    ASSERT_TRUE(read) << read.error().message();
    const GridGeometry& grid = read->scan.geometry();
    EXPECT_EQ(grid.dims, (std::array{5, 4, kPictures}));
    EXPECT_EQ(grid.spacing_mm, Eigen::Vector3d(0.05, 0.06, 0.2));
    EXPECT_FALSE(read->header.has_geometry) << "pictures do not say which side is left";
    for (int k = 0; k < kPictures; ++k)
      for (int j = 0; j < 4; ++j)
        for (int i = 0; i < 5; ++i)
          EXPECT_EQ(read->scan.at(i, j, k),
                    static_cast<float>(slice(end, k).pixels[static_cast<std::size_t>(j * 5 + i)]));
  }

  const test::TemporaryFolder folder_;
  std::string warnings_;
};

TEST(NaturalOrder, NumbersAreCompared) {
  using volume_io::natural_less;
  EXPECT_TRUE(natural_less("slice2.png", "slice10.png"));
  EXPECT_FALSE(natural_less("slice10.png", "slice2.png"));
  EXPECT_TRUE(natural_less("slice002.png", "slice10.png"));
  EXPECT_TRUE(natural_less("a1b2", "a1b10"));
  EXPECT_TRUE(natural_less("Slice1", "slice2"));
  EXPECT_TRUE(natural_less("slice", "slice1"));
  // a strict order: names that differ only by zeros are ordered, and no name precedes itself
  EXPECT_NE(natural_less("s01", "s1"), natural_less("s1", "s01"));
  EXPECT_FALSE(natural_less("s1", "s1"));
}

TEST_F(ImageStack, GreyOfEightAndSixteenBitsIsAScan) {
  write_stack(256, PngKind::kGrey8);
  EXPECT_TRUE(is_volume(folder_ / "stack"));
  expect_scan(scan(), 256);
  write_stack(65536, PngKind::kGrey16);
  expect_scan(scan(), 65536);
  EXPECT_EQ(scan()->header.component_type, "uint16");
}

TEST_F(ImageStack, PagesOfATiffAreSlices) {
  std::vector<Picture> pages;
  for (int k = 0; k < kPictures; ++k) pages.push_back(slice(65536, k));
  TiffLayout layout;
  layout.bits = 16;
  layout.packing = TiffLayout::Packing::kLzw;
  write("all.tif", test::tiff_of(pages, layout));
  expect_scan(scan(), 65536);
  const auto alone = read_scan(folder_ / "stack" / "all.tif");
  ASSERT_TRUE(alone) << alone.error().message();
  EXPECT_EQ(alone->scan.voxels(), scan()->scan.voxels());
}

TEST_F(ImageStack, GreyThatIsStoredInColoursIsAScan) {
  for (int k = 0; k < kPictures; ++k) {
    Picture picture = slice(256, k);
    for (std::uint32_t& pixel : picture.pixels) pixel = pixel << 16 | pixel << 8 | pixel;
    write("slice" + std::to_string(k + 1) + ".png", test::png_of(picture, PngKind::kRgb));
  }
  const auto read = read_volume(folder_ / "stack");
  ASSERT_TRUE(read) << read.error().message();
  ASSERT_TRUE(std::holds_alternative<ScanFile>(*read));
  expect_scan(scan(), 256);
}

TEST_F(ImageStack, ColoursAreLabelsThatATableNames) {
  constexpr std::array<std::uint32_t, 4> kColours{0, 0x0000FF, 0x00FF00, 0xFA0A00};
  for (int k = 0; k < kPictures; ++k) {
    Picture picture = slice(4, k);
    for (std::uint32_t& pixel : picture.pixels) pixel = kColours[pixel];
    // an individual palette for each slice, as written by some programs
    write("slice" + std::to_string(k + 1) + ".png",
          test::png_of(picture, k % 2 ? PngKind::kPalette : PngKind::kRgb));
  }
  std::ofstream(folder_ / "names.ctbl") << "7 cochlea 250 10 0 255\n8 facial_nerve 0 0 255 255\n";
  const auto read = labels(folder_ / "names.ctbl");
  ASSERT_TRUE(read) << read.error().message();
  EXPECT_THAT(warnings_, HasSubstr("one for each of its 3 colours"));
  ASSERT_EQ(read->labels.segments.size(), 3u);
  EXPECT_EQ(read->labels.segments[0].name, "facial_nerve");
  EXPECT_EQ(read->labels.segments[1].name, "");
  EXPECT_EQ(read->labels.segments[2].name, "cochlea");
  EXPECT_EQ(read->labels.segments[2].colour, (Rgb{250, 10, 0}));
  for (int k = 0; k < kPictures; ++k)
    for (int n = 0; n < 20; ++n)
      EXPECT_EQ(read->labels.layers[0].at(n % 5, n / 5, k), slice(4, k).pixels[static_cast<std::size_t>(n)]);
  const auto unasked = read_volume(folder_ / "stack");
  ASSERT_TRUE(unasked) << unasked.error().message();
  EXPECT_TRUE(std::holds_alternative<LabelFile>(*unasked));
  // read as a scan, by luminance
  const auto grey = scan();
  ASSERT_TRUE(grey) << grey.error().message();
  EXPECT_THAT(warnings_, HasSubstr("by its brightness"));
  EXPECT_EQ(*std::ranges::max_element(grey->scan.voxels()), 182.f) << "of green";
}

TEST_F(ImageStack, TooManyColoursAreCounted) {
  for (int k = 0; k < 2; ++k) {
    Picture picture{100, 50, {}};
    for (std::uint32_t n = 0; n < 5000; ++n)
      picture.pixels.push_back((n + 1) * 16 + static_cast<std::uint32_t>(k));
    write(std::to_string(k) + ".png", test::png_of(picture, PngKind::kRgb));
  }
  const auto read = labels();
  ASSERT_FALSE(read);
  EXPECT_THAT(read.error().what, AllOf(HasSubstr("has 10000 distinct colours"), HasSubstr("4096")));
  EXPECT_THAT(read.error().remedy, HasSubstr("--scan"));
}

TEST_F(ImageStack, SlicesThatDifferAreBothNamed) {
  write_stack(256, PngKind::kGrey8);
  write("slice7.png", test::png_of(test::some_picture(256, 0, 6, 4), PngKind::kGrey8));
  const auto size = scan();
  ASSERT_FALSE(size);
  EXPECT_THAT(size.error().what,
              AllOf(HasSubstr("slice1.png has 5 x 4 pixels"), HasSubstr("slice7.png has 6 x 4")));
  EXPECT_THAT(size.error().remedy, Not(IsEmpty()));
  write("slice7.png", test::png_of(slice(65536, 6), PngKind::kGrey16));
  const auto kind = scan();
  ASSERT_FALSE(kind);
  EXPECT_THAT(kind.error().what,
              AllOf(HasSubstr("of uint8"), HasSubstr("slice7.png"), HasSubstr("of uint16")));
}

TEST_F(ImageStack, TheSpacingIsAskedFor) {
  write_stack(256, PngKind::kGrey8);
  set_placement_options({});
  const auto unsaid = scan();
  ASSERT_FALSE(unsaid);
  EXPECT_THAT(unsaid.error().what, HasSubstr("a stack of 12 pictures without a voxel spacing"));
  EXPECT_THAT(unsaid.error().remedy, HasSubstr("--spacing X,Y,Z"));
  // settings of a scene take precedence over those of the program
  const auto declared = read_scan(folder_ / "stack", {}, {}, VoxelCaching::kOff, {},
                                  {.image_spacing_mm = Eigen::Vector3d(1, 2, 3)});
  ASSERT_TRUE(declared) << declared.error().message();
  EXPECT_EQ(declared->scan.geometry().spacing_mm, Eigen::Vector3d(1, 2, 3));
}

TEST_F(ImageStack, ReportsFilesThatAreNotSlices) {
  write_stack(256, PngKind::kGrey8);
  write("readme.txt", "nothing");
  write(".hidden.png", "nothing");
  expect_scan(scan(), 256);
  EXPECT_THAT(warnings_, HasSubstr("1 other file in it is no picture"));
  write("slice5.png", test::png_of(slice(256, 4), PngKind::kGrey8).substr(0, 60));
  const auto cut = scan();
  ASSERT_FALSE(cut);
  EXPECT_EQ(cut.error().where, (folder_ / "stack" / "slice5.png").string());
  EXPECT_THAT(cut.error().what, HasSubstr("damaged or cut short"));
}

TEST_F(ImageStack, ASinglePictureIsNoVolume) {
  write("one.png", test::png_of(slice(256, 0), PngKind::kGrey8));
  write("page.tif", test::tiff_of({slice(256, 0)}, {}));
  std::filesystem::rename(folder_ / "stack" / "page.tif", folder_ / "page.tif");
  for (const auto& [file, what] : {std::pair{folder_ / "stack", "is a single picture"},
                                   {folder_ / "page.tif", "is a single picture"},
                                   {folder_ / "stack" / "one.png", "is a picture (PNG)"}}) {
    const auto read = read_scan(file);
    ASSERT_FALSE(read);
    EXPECT_THAT(read.error().what, HasSubstr(what));
    EXPECT_THAT(read.error().remedy, HasSubstr("give the folder with all"));
  }
}

}  // namespace
}  // namespace palpate
