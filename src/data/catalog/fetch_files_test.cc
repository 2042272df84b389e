#include "catalog/fetch_files.h"

#include <gmock/gmock.h>

#include "base/test_folder.h"
#include "catalog/digest.h"
#include "catalog/local_data.h"
#include "catalog/test_server.h"
#include "palpate/volume_io/write_volume.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;
using test::bytes_of_file;
using test::TemporaryFolder;
using test::write_text;
using testing::ElementsAre;
using testing::HasSubstr;

// small data set on a local server: labels, their names and an optional image
class FetchFilesTest : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(server_.running()) << "needs python3";
    fs::create_directories(served_ / "data");
    ASSERT_TRUE(write_volume(served_ / "data/labels.nrrd", Volume<std::uint16_t>(grid_, 1)));
    write_text(served_ / "data/names.tsv", "value\tname\n1\tbone\n");
    serve_image(grid_);
    entry_.name = "small";
    entry_.files = {
        {.role = DataRole::kLabels, .name = "labels.nrrd", .remote = "data/labels.nrrd"},
        {.role = DataRole::kNames, .name = "names.tsv", .remote = "data/names.tsv"},
        {.role = DataRole::kScan, .name = "image.nrrd", .remote = "data/image.nrrd", .required = false}};
    for (auto& file : entry_.files) file.sha256 = *sha256_of_file(served_ / file.remote);
  }

  void serve_image(const GridGeometry& grid) {
    ASSERT_TRUE(write_volume(served_ / "data/image.nrrd", Volume<float>(grid, 0.5f)));
    if (!entry_.files.empty()) entry_.files[2].sha256 = *sha256_of_file(served_ / "data/image.nrrd");
  }
  Result<void> get(const std::string& behaviour) {
    FetchOptions options;
    options.mirror = server_.url(behaviour);
    return fetch_files(entry_, into_.path(), options, {}, warn_);
  }
  std::vector<std::string> present() const {
    std::vector<std::string> names;
    for (const auto& file : fs::directory_iterator(into_.path())) names.push_back(file.path().filename());
    std::sort(names.begin(), names.end());
    return names;
  }

  GridGeometry grid_ = [] {
    GridGeometry grid;
    grid.dims = {4, 5, 6};
    grid.spacing_mm = {0.5, 0.5, 1.5};
    grid.direction = Eigen::Vector3d(-1, 1, 1).asDiagonal();
    grid.origin = Point<Patient>(10.25, -20, 33);
    return grid;
  }();
  TemporaryFolder served_, into_;
  test::TestServer server_{served_.path()};
  CatalogEntry entry_;
  std::vector<std::string> warnings_;
  Warn warn_ = [this](const std::string& message) { warnings_.push_back(message); };
};

TEST_F(FetchFilesTest, EverythingWithItsImage) {
  ASSERT_TRUE(get("ok/"));
  EXPECT_TRUE(warnings_.empty()) << warnings_.front();
  EXPECT_THAT(present(), ElementsAre("image.nrrd", "labels.nrrd", "names.tsv"));
  const auto data = local_data_in(entry_, into_.path());
  ASSERT_TRUE(data && *data);
  EXPECT_EQ((*data)->scan, into_ / "image.nrrd");
  EXPECT_EQ((*data)->names, into_ / "names.tsv");
}

TEST_F(FetchFilesTest, ImageOnAnotherGridIsDropped) {
  auto moved = grid_;
  moved.origin = Point<Patient>(11.25, -20, 33);
  auto mirrored = grid_;
  mirrored.direction = Eigen::Matrix3d::Identity();
  auto shorter = grid_;
  shorter.dims[2] = 5;
  for (const auto& other : {moved, mirrored, shorter}) {
    warnings_.clear();
    serve_image(other);
    ASSERT_TRUE(get("ok"));
    EXPECT_THAT(present(), ElementsAre("labels.nrrd", "names.tsv"));
    EXPECT_THAT(warnings_, ElementsAre(HasSubstr("image.nrrd does not lie on the label map's grid")));
  }
}

TEST_F(FetchFilesTest, ImageThatIsNoVolumeIsDropped) {
  write_text(served_ / "data/image.nrrd", "this is no volume");
  entry_.files[2].sha256 = *sha256_of_file(served_ / "data/image.nrrd");
  ASSERT_TRUE(get("ok"));
  EXPECT_THAT(present(), ElementsAre("labels.nrrd", "names.tsv"));
  EXPECT_EQ(warnings_.size(), 1u);
}

TEST_F(FetchFilesTest, MissingExtraIsAWarningMissingLabelsAreAnError) {
  fs::remove(served_ / "data/image.nrrd");
  ASSERT_TRUE(get("ok"));
  EXPECT_THAT(warnings_, ElementsAre(testing::AllOf(HasSubstr("image.nrrd"), HasSubstr("404"))));
  fs::remove(into_ / "labels.nrrd");
  fs::remove(served_ / "data/labels.nrrd");
  const auto done = get("ok");
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().kind, ErrorKind::kUnavailable);
}

TEST_F(FetchFilesTest, FetchesOnlyMissingOrDamagedFiles) {
  ASSERT_TRUE(get("ok"));
  const auto labels_written = fs::last_write_time(into_ / "labels.nrrd");
  write_text(into_ / "names.tsv", "damaged");
  ASSERT_TRUE(get("ok"));
  EXPECT_EQ(bytes_of_file(into_ / "names.tsv"), "value\tname\n1\tbone\n");
  EXPECT_EQ(fs::last_write_time(into_ / "labels.nrrd"), labels_written);
  // a server without the files is not contacted
  ASSERT_TRUE(get("missing"));
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(FetchFilesTest, DamagedAfterwardsIsNotUsed) {
  ASSERT_TRUE(get("ok"));
  write_text(into_ / "image.nrrd", "damaged");
  const auto data = local_data_in(entry_, into_.path());
  ASSERT_FALSE(data);
  EXPECT_THAT(data.error().what, HasSubstr(entry_.files[2].sha256));
}

}  // namespace
}  // namespace palpate
