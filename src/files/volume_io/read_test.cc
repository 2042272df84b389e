#include <gtest/gtest.h>
#include <zlib.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "base/test_files.h"
#include "palpate/volume_io/volume_io.h"
#include "volume_io/value_statistics.h"

namespace palpate {
namespace {

using volume_io::VolumeContent;

using test::TemporaryFolder;
using test::write_text;

std::string nrrd(const std::string& type, const std::string& sizes, const std::string& more,
                 const std::string& data) {
  const bool flat = std::count(sizes.begin(), sizes.end(), ' ') == 1;
  return "NRRD0004\ntype: " + type + "\ndimension: " + (flat ? "2" : "3") + "\nsizes: " + sizes + "\n" +
         (flat ? "" : "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n") +
         more + "\n" + data;
}

// values as bytes, in either byte order
template <class T>
std::string stored(const std::vector<T>& values, bool big_endian) {
  std::string bytes;
  for (const T value : values) {
    char one[sizeof(T)];
    std::memcpy(one, &value, sizeof(T));
    if (big_endian) std::reverse(one, one + sizeof(T));
    bytes.append(one, sizeof(T));
  }
  return bytes;
}

std::string gzipped(const std::string& bytes) {
  z_stream z{};
  EXPECT_EQ(deflateInit2(&z, 9, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY), Z_OK);
  std::string packed(bytes.size() + 1000, '\0');
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  z.avail_in = static_cast<uInt>(bytes.size());
  z.next_out = reinterpret_cast<Bytef*>(packed.data());
  z.avail_out = static_cast<uInt>(packed.size());
  EXPECT_EQ(deflate(&z, Z_FINISH), Z_STREAM_END);
  packed.resize(z.total_out);
  deflateEnd(&z);
  return packed;
}

template <class T>
void expect_every_type(const std::string& name, const std::vector<T>& values) {
  const TemporaryFolder folder;
  std::vector<float> expected;
  for (const T v : values) expected.push_back(static_cast<float>(v));
  const std::string sizes = std::to_string(values.size()) + " 1 1";
  for (const bool big : {false, true}) {
    const std::string endian = big ? "endian: big\n" : "endian: little\n";
    const auto raw = read_scan(
        write_text(folder / "a.nrrd", nrrd(name, sizes, endian + "encoding: raw\n", stored(values, big))));
    ASSERT_TRUE(raw) << name << ": " << raw.error().message();
    EXPECT_EQ(raw->scan.voxels(), expected) << name;
    EXPECT_EQ(raw->header.component_type, name);
    const auto gz = read_scan(write_text(
        folder / "b.nrrd", nrrd(name, sizes, endian + "encoding: gzip\n", gzipped(stored(values, big)))));
    ASSERT_TRUE(gz) << gz.error().message();
    EXPECT_EQ(gz->scan.voxels(), expected) << name;
  }
}

TEST(ReadScan, ReadsEveryTypeInBothByteOrders) {
  expect_every_type<std::int8_t>("int8", {-128, -1, 0, 127});
  expect_every_type<std::uint8_t>("uint8", {0, 1, 255});
  expect_every_type<std::int16_t>("int16", {-32768, -1, 258, 32767});
  expect_every_type<std::uint16_t>("uint16", {0, 258, 65535});
  expect_every_type<std::int32_t>("int32", {-16777216, 16909060, 16777216});
  expect_every_type<std::uint32_t>("uint32", {0, 16777216});
  expect_every_type<std::int64_t>("int64", {-16777216, 1});
  expect_every_type<std::uint64_t>("uint64", {16777216, 1});
}

TEST(ReadScan, ReadsFloatsTextAndHexadecimal) {
  const TemporaryFolder folder;
  const auto text = read_scan(
      write_text(folder / "t.nrrd", nrrd("float", "2 2 1", "encoding: text\n", "1.5, -2\n3e2\t0.25")));
  ASSERT_TRUE(text) << text.error().message();
  EXPECT_EQ(text->scan.voxels(), (std::vector<float>{1.5f, -2, 300, 0.25f}));
  const auto hex = read_scan(write_text(
      folder / "h.nrrd", nrrd("uint16", "2 1 1", "endian: big\nencoding: hex\n", "01 02\n fF10\n")));
  ASSERT_TRUE(hex) << hex.error().message();
  EXPECT_EQ(hex->scan.voxels(), (std::vector<float>{258, 65296}));
}

// volume of one row with these values along x
std::filesystem::path write_row(const TemporaryFolder& folder, const std::vector<int>& values) {
  std::string text;
  for (const int value : values) text += std::to_string(value) + " ";
  return write_text(folder / "row.nrrd",
                    nrrd("int16", std::to_string(values.size()) + " 1 1", "encoding: ascii\n", text));
}

TEST(ReadVolume, LabelsAreWholeAndInPatches) {
  const TemporaryFolder folder;
  const auto are_labels = [&](const std::vector<int>& values) {
    const auto volume = read_volume(write_row(folder, values));
    EXPECT_TRUE(volume.ok());
    return volume.ok() && std::holds_alternative<LabelFile>(*volume);
  };
  EXPECT_TRUE(are_labels({0, 1, 1, 1, 2, 2, 2, 0}));
  EXPECT_FALSE(are_labels({0, 1, 2, 3, 4, 5, 6, 0})) << "they change from voxel to voxel";
  EXPECT_FALSE(are_labels({-1, 1, 1, 1, 2, 2, 2, 0}));
  EXPECT_TRUE(are_labels({0, 5000, 5000, 5000, 0})) << "by patches, whatever the numbers";
  EXPECT_FALSE(are_labels({0, 0, 0})) << "nothing is no label map";
}

TEST(ReadVolume, AScanTakenForLabelsIsRefused) {
  const TemporaryFolder folder;
  const auto refusal_of = [&](const std::vector<int>& row, const auto&... how) {
    const auto read = read_labels(write_row(folder, row), how...);
    return read ? std::string() : read.error().message();
  };
  const auto rising = [](int values, int run) {
    std::vector<int> row;
    for (int n = 0; n < values * run; ++n) row.push_back(1 + n / run);
    return row;
  };
  const std::vector<int> scan = rising(200, 1);
  EXPECT_NE(refusal_of(scan).find("looks like a scan"), std::string::npos);
  EXPECT_EQ(refusal_of(rising(200, 4)), "") << "many labels in patches";
  EXPECT_EQ(refusal_of(rising(30, 1)), "") << "few labels";

  // a smooth 8-bit scan repeats values in small steps; the parcels of an atlas have arbitrary numbers
  std::vector<int> smooth, atlas;
  for (int n = 0; n < 4000; ++n) {
    smooth.push_back(static_cast<int>(std::lround(128 + 100 * std::sin(n / 200.0))));
    atlas.push_back(1 + (n / 2 * 137) % 900);
  }
  for (int n = 0; n < 4000; n += 2)
    smooth.insert(smooth.end(), {100 + n % 140, 100 + n % 140, 101 + n % 140});
  EXPECT_NE(refusal_of(smooth).find("looks like a scan"), std::string::npos);
  EXPECT_EQ(refusal_of(atlas), "") << "parcels of two voxels";

  // an explicit declaration as labels, by a table or a switch, takes precedence
  std::string warning;
  const auto warn = [&](const std::string& declared) { warning = declared; };
  EXPECT_EQ(refusal_of(scan, std::nullopt, Progress(), Warn(warn), AmbiguousLabels::kWarn), "");
  EXPECT_NE(warning.find("looks like a scan"), std::string::npos);
  std::string table = "value\tname\n";
  for (int n = 1; n <= 120; ++n) table += std::to_string(n) + "\tparcel " + std::to_string(n) + "\n";
  EXPECT_EQ(refusal_of(scan, write_text(folder / "table.tsv", table)), "");
}

TEST(ReadScan, ASliceIsAVolumeOfOne) {
  const TemporaryFolder folder;
  const auto scan = read_scan(write_text(
      folder / "s.nrrd", nrrd("uint8", "3 2", "spacings: 0.5 2\nencoding: ascii\n", "1 2 3 4 5 6")));
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.geometry().dims, (std::array{3, 2, 1}));
  EXPECT_EQ(scan->scan.geometry().spacing_mm, Eigen::Vector3d(0.5, 2, 1));
  EXPECT_FALSE(scan->header.has_geometry);
}

TEST(ReadScan, RasIsTurnedIntoLps) {
  const TemporaryFolder folder;
  std::string text = nrrd("uint8", "1 1 2", "encoding: ascii\n", "1 2");
  text.replace(text.find("LPS"), 3, "RAS");
  text.replace(text.find("(1,0,0)"), 7, "(2,0,0)");
  text.replace(text.find("origin: (0,0,0)"), 15, "origin: (5,6,7)");
  const auto header = read_header(write_text(folder / "r.nrrd", text));
  ASSERT_TRUE(header) << header.error().message();
  EXPECT_EQ(header->geometry.direction, Eigen::Matrix3d(Eigen::Vector3d(-1, -1, 1).asDiagonal()));
  EXPECT_EQ(header->geometry.spacing_mm, Eigen::Vector3d(2, 1, 1));
  EXPECT_EQ(header->geometry.origin, Point<Patient>(-5, -6, 7));
}

TEST(ReadScan, ReplacesNaNWithAWarning) {
  const TemporaryFolder folder;
  std::string warning;
  const Warn warn = [&](const std::string& message) { warning = message; };
  const auto scan = read_scan(
      write_text(folder / "n.nrrd", nrrd("float", "2 2 1", "encoding: text\n", "nan -7 inf 3")), {}, warn);
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.voxels(), (std::vector<float>{-7, -7, -7, 3}));
  EXPECT_NE(warning.find("2 voxels"), std::string::npos) << warning;
  EXPECT_FALSE(
      read_scan(write_text(folder / "m.nrrd", nrrd("float", "1 2 1", "encoding: text\n", "nan nan"))));
}

TEST(ReadScan, StopsWhenAskedTo) {
  const TemporaryFolder folder;
  const auto file = write_text(folder / "a.nrrd", nrrd("uint8", "2 1 1", "encoding: ascii\n", "1 2"));
  const std::atomic<bool> stop = true;
  const auto scan = read_scan(file, Progress({}, &stop));
  ASSERT_FALSE(scan);
  EXPECT_EQ(scan.error().kind, ErrorKind::kInterrupted);
}

// detached data after a header, ending 3 bytes before the end of the file, compressed or not
TEST(ReadScan, FindsDetachedDataBySkips) {
  const TemporaryFolder folder;
  const std::string data = "line\nheadABCDend";
  write_text(folder / "a.raw", data);
  write_text(folder / "a.raw.gz", gzipped(data.substr(5)));
  const std::vector<float> expected{'A', 'B', 'C', 'D'};
  for (const std::string& context : {std::string("encoding: raw\nbyte skip: 9\ndata file: a.raw\n"),
                                     std::string("encoding: raw\nbyte skip: -4\ndata file: a.raw\n"),
                                     std::string("encoding: gzip\nbyte skip: -4\ndata file: a.raw.gz\n")}) {
    const auto scan = read_scan(write_text(folder / "a.nhdr", nrrd("uint8", "2 2 1", context, "")));
    // data after the voxels are allowed only if they are declared
    if (context.find("skip: 9") != std::string::npos) {
      EXPECT_FALSE(scan) << "3 bytes too many";
      continue;
    }
    ASSERT_TRUE(scan) << context << scan.error().message();
    EXPECT_EQ(scan->scan.voxels(), expected) << context;
  }
  write_text(folder / "b.raw", "line\nheadABCD");
  const auto lines = read_scan(write_text(
      folder / "b.nhdr",
      nrrd("uint8", "2 2 1", "encoding: raw\nline skip: 1\nbyte skip: 4\ndata file: b.raw\n", "")));
  ASSERT_TRUE(lines) << lines.error().message();
  EXPECT_EQ(lines->scan.voxels(), expected);
}

TEST(ReadScan, AHeaderMayNotLeadOutOfItsFolder) {
  const TemporaryFolder folder;
  write_text(folder / "secret.raw", "ABCD");
  std::filesystem::create_directory(folder / "in");
  for (const std::string& name :
       {(folder / "secret.raw").string(), std::string("../secret.raw"), std::string("in/../../x"),
        std::string("/dev/zero"), std::string("in"), std::string("missing.raw")}) {
    const auto nhdr = read_scan(write_text(
        folder / "in/a.nhdr", nrrd("uint8", "2 2 1", "encoding: raw\ndata file: " + name + "\n", "")));
    EXPECT_FALSE(nhdr) << name;
    const auto mhd = read_scan(write_text(
        folder / "in/a.mhd",
        "ObjectType = Image\nNDims = 3\nDimSize = 2 2 1\nElementType = MET_UCHAR\nElementDataFile = " + name +
            "\n"));
    EXPECT_FALSE(mhd) << name;
  }
}

TEST(ReadScan, ReadsMetaImageWithItsDataElsewhere) {
  const TemporaryFolder folder;
  write_text(folder / "a.raw", stored<std::int16_t>({1, -2, 300, 4}, true));
  const auto scan =
      read_scan(write_text(folder / "a.mhd",
                           "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = "
                           "True\nTransformMatrix = 0 1 0 -1 0 0 0 0 "
                           "1\nOffset = 1 2 3\nElementSpacing = 2 3 4\nDimSize = 2 2 1\nElementType = "
                           "MET_SHORT\nElementDataFile = a.raw\n"));
  ASSERT_TRUE(scan) << scan.error().message();
  EXPECT_EQ(scan->scan.voxels(), (std::vector<float>{1, -2, 300, 4}));
  EXPECT_EQ(scan->header.format, "MetaImage");
  // the first axis is along +y, the second along -x
  const auto X_PatientVoxel = scan->scan.geometry().X_PatientVoxel();
  EXPECT_EQ(X_PatientVoxel * Point<Voxel>(1, 0, 0), Point<Patient>(1, 4, 3));
  EXPECT_EQ(X_PatientVoxel * Point<Voxel>(0, 1, 0), Point<Patient>(-2, 2, 3));
}

TEST(ReadLabels, OnlyWholeNumbersFromZeroTo65535AreLabels) {
  const TemporaryFolder folder;
  const auto read = [&](const std::string& type, const std::string& values) {
    return read_labels(write_text(folder / "l.nrrd", nrrd(type, "2 1 2", "encoding: text\n", values)));
  };
  const auto good = read("double", "0 65535 1 1");
  ASSERT_TRUE(good) << good.error().message();
  ASSERT_EQ(good->labels.segments.size(), 2u);
  EXPECT_EQ(good->labels.segments[1].id, 65535);
  EXPECT_FALSE(read("int", "0 1 -1 2"));
  EXPECT_FALSE(read("int", "0 1 65536 2"));
  EXPECT_FALSE(read("float", "0 1 nan 2"));
  const auto half = read("float", "0 1 2 2.5");
  ASSERT_FALSE(half);
  EXPECT_NE(half.error().what.find("(1, 0, 1)"), std::string::npos) << half.error().message();
}

// overlapping segments as saved by 3D Slicer, and with the layers as the slowest axis
TEST(ReadLabels, ReadsOverlappingSegmentsFromLayers) {
  const TemporaryFolder folder;
  const std::string fields =
      "Segment0_ID:=a\nSegment0_Name:=bone\nSegment0_LabelValue:=1\nSegment0_Layer:=0\nSegment0_Color:=1 0 "
      "0\n"
      "Segment1_ID:=b\nSegment1_Name:=growth\nSegment1_LabelValue:=1\nSegment1_Layer:=1\nSegment1_Color:=0 1 "
      "0\n";
  const auto file = [&](const std::string& sizes, const std::string& kinds, const std::string& directions,
                        const std::string& data) {
    return write_text(folder / "s.seg.nrrd",
                      "NRRD0004\ntype: uint8\ndimension: 4\nspace: left-posterior-superior\nsizes: " + sizes +
                          "\nspace directions: " + directions + "\nkinds: " + kinds +
                          "\nencoding: ascii\nspace origin: (0,0,0)\n" + fields + "\n" + data);
  };
  // voxels: bone, both, growth, and an undeclared 5 in the second layer
  const auto first = read_labels(
      file("2 4 1 1", "list domain domain domain", "none (1,0,0) (0,1,0) (0,0,1)", "1 0 1 1 0 1 0 5"));
  ASSERT_TRUE(first) << first.error().message();
  EXPECT_EQ(first->header.layers, 2);
  EXPECT_TRUE(first->header.has_segments);
  EXPECT_EQ(first->header.format, "Slicer segmentation (NRRD)");
  ASSERT_EQ(first->labels.layers.size(), 2u);
  EXPECT_EQ(first->labels.layers[0].voxels(), (std::vector<LabelId>{1, 1, 0, 0}));
  EXPECT_EQ(first->labels.layers[1].voxels(), (std::vector<LabelId>{0, 1, 1, 5}));
  ASSERT_EQ(first->labels.segments.size(), 3u);
  EXPECT_EQ(first->labels.find("bone")->id, 1);
  EXPECT_EQ(first->labels.find("growth")->layer, 1);
  EXPECT_EQ(first->labels.find("growth")->colour, (Rgb{0, 255, 0}));
  EXPECT_EQ(first->unnamed, (std::vector<LabelId>{5}));
  EXPECT_EQ(first->labels.flattened().voxels(), (std::vector<LabelId>{1, 6, 6, 5}));

  const auto last = read_labels(
      file("4 1 1 2", "domain domain domain list", "(1,0,0) (0,1,0) (0,0,1) none", "1 1 0 0 0 1 1 5"));
  ASSERT_TRUE(last) << last.error().message();
  EXPECT_EQ(last->labels.layers[1].voxels(), first->labels.layers[1].voxels());

  EXPECT_FALSE(read_scan(folder / "s.seg.nrrd")) << "layers are no scan";
}

// other texts of a file are dropped, so they cannot reach an output
TEST(ReadLabels, KeepsNoTextButNames) {
  const TemporaryFolder folder;
  const auto labels = read_labels(
      write_text(folder / "p.nrrd",
                 nrrd("uint8", "2 1 1",
                      "content: DOE^CANARY\nencoding: ascii\nDicom.PatientName:=DOE^CANARY\n", "0 1")));
  ASSERT_TRUE(labels) << labels.error().message();
  for (const Segment& s : labels->labels.segments) EXPECT_EQ(s.name, "");
  EXPECT_EQ(labels->header.format, "NRRD");
}

TEST(Read, NonVolumeFilesAreErrors) {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder / "d.nrrd");
  for (const auto& file :
       {folder / "missing.nrrd", folder / "d.nrrd", write_text(folder / "a.txt", "x"),
        write_text(folder / "nrrd", ""), write_text(folder / "a.nrrd", ""), write_text(folder / "a.nii", ""),
        write_text(folder / "a.nii.gz", ""), write_text(folder / "a.mha", ""),
        write_text(folder / "b.img", ""), write_text(folder / "a.hdr", "")}) {
    const auto header = read_header(file);
    ASSERT_FALSE(header) << file;
    EXPECT_EQ(header.error().kind, ErrorKind::kBadInput);
    EXPECT_NE(header.error().where.find(file.filename().string()), std::string::npos);
    EXPECT_FALSE(header.error().what.empty());
    EXPECT_FALSE(read_scan(file));
    EXPECT_FALSE(read_labels(file));
  }
}

// Volumes of more than a million voxels are counted in pieces by several threads.
TEST(ContentOf, CountsEveryPiece) {
  using volume_io::statistics_of;
  constexpr std::size_t kVoxels = (std::size_t{5} << 19) + 17, kPiece = std::size_t{1} << 20;
  std::vector<float> voxels(kVoxels);
  EXPECT_EQ(statistics_of(voxels).distinct, 0u);
  for (const std::size_t at : {std::size_t{0}, kPiece - 1, kPiece, kVoxels - 1}) {
    for (const float value : {1.F, 65535.F}) {
      voxels[at] = value;
      const volume_io::ValueStatistics one = statistics_of(voxels);
      EXPECT_EQ(one.distinct, 1u);
      EXPECT_TRUE(one.is_present[static_cast<std::size_t>(value)]) << value << " at " << at;
    }
    for (const float value : {-1.F, 0.5F, 65536.F, std::numeric_limits<float>::quiet_NaN()}) {
      voxels[at] = value;
      EXPECT_FALSE(statistics_of(voxels).only_whole) << value << " at " << at;
    }
    voxels[at] = 0;
  }
  // pairs within a piece and across two; a run across two pieces counts once
  voxels[10] = voxels[11] = voxels[kPiece - 1] = 2;
  voxels[kPiece] = 3;
  voxels[kPiece + 1] = 9;
  for (std::size_t n = 0; n < 6; ++n) voxels[2 * kPiece - 3 + n] = 7;
  const volume_io::ValueStatistics some = statistics_of(voxels);
  EXPECT_EQ(some.distinct, 4u);
  EXPECT_EQ(some.equal, 1u + 5u);
  EXPECT_EQ(some.unequal, 2u);
  EXPECT_EQ(some.near, 1u);
  EXPECT_EQ(some.median_run, 1.5) << "2: 3 voxels in 2 runs, 3 and 9 one, 7 six in one: the upper median";
}

// ---- typical volumes ------------------------------------------------------------------------------------

// 48 voxels along each axis, i fastest
constexpr int kSide = 48;
template <class Value>
std::vector<int> cube(const Value& value) {
  std::vector<int> values;
  for (int k = 0; k < kSide; ++k)
    for (int j = 0; j < kSide; ++j)
      for (int i = 0; i < kSide; ++i) values.push_back(value(i, j, k));
  return values;
}

VolumeContent::Kind kind_of_values(const std::vector<int>& values) {
  return volume_io::content_by_values(volume_io::statistics_of({values.begin(), values.end()})).kind;
}

double radius(int i, int j, int k) {
  const double midpoint = 0.5 * (kSide - 1);
  return std::hypot(i - midpoint, j - midpoint, k - midpoint);
}

TEST(ContentOf, GreyValuesOfEightBitsAreAScan) {
  using Kind = VolumeContent::Kind;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 1);
  const auto grey = [](double value) { return static_cast<int>(std::clamp(std::round(value), 0.0, 255.0)); };
  // micro-CT: saturated metal or bone, noise elsewhere, nothing outside the field of view
  const auto micro_ct = cube([&](int i, int j, int k) {
    const double r = radius(i, j, k);
    return r > 23 ? 0 : r < 19 ? 255 : grey(100 + 30 * noise(random));
  });
  EXPECT_EQ(kind_of_values(micro_ct), Kind::kScan);
  // the same without noise, blurred: steps of one or two grey values
  EXPECT_EQ(kind_of_values(cube([&](int i, int j, int k) {
              const double r = radius(i, j, k);
              return r > 23 ? 0 : grey(255 - 3 * r);
            })),
            Kind::kScan);
  EXPECT_EQ(kind_of_values(cube([&](int i, int j, int k) {
              const double r = radius(i, j, k);
              return r > 23 ? 0 : grey(255 - 0.6 * r);
            })),
            Kind::kUnclear)
      << "shells of two voxels, which an atlas may have as well";
  // little noise on few tissues
  EXPECT_EQ(kind_of_values(cube([&](int i, int j, int k) {
              const double r = radius(i, j, k);
              return r > 23 ? 0 : grey((r > 12 ? 90 : 160) + 0.6 * noise(random));
            })),
            Kind::kScan);
}

TEST(ContentOf, ParcelsAreLabelsHoweverMany) {
  using Kind = VolumeContent::Kind;
  // 512 parcels of 6 x 6 x 6 voxels with gaps, values in random order, up to 65533
  const auto parcels = cube([](int i, int j, int k) {
    if (i % 6 == 0 || j % 6 == 0) return 0;
    const int parcel = i / 6 + 8 * (j / 6) + 64 * (k / 6);
    return 1 + (parcel * 7919) % 65533;
  });
  EXPECT_EQ(kind_of_values(parcels), Kind::kLabels);
  // numbered along i, so that neighbours differ by 1
  EXPECT_EQ(kind_of_values(cube([](int i, int j, int k) { return 1 + i / 6 + 8 * (j / 6) + 64 * (k / 6); })),
            Kind::kUnclear);
  EXPECT_EQ(kind_of_values(cube([](int i, int, int) { return 1 + i / 6; })), Kind::kLabels);
  // a fine atlas, two voxels wide
  EXPECT_EQ(kind_of_values(cube(
                [](int i, int j, int k) { return 1 + (i / 2 + 24 * (j / 8) + 144 * (k / 8)) * 97 % 6000; })),
            Kind::kLabels);
}

TEST(ReadVolume, ReportsTheEvidenceAndRejectsUnclearValues) {
  const TemporaryFolder folder;
  const auto read_row = [&](const std::vector<int>& row) { return read_volume(write_row(folder, row)); };
  const auto labels = read_row({0, 1, 1, 1, 2, 2, 2, 0});
  ASSERT_TRUE(labels.ok());
  EXPECT_EQ(std::get<LabelFile>(*labels).evidence, "its 2 values form patches");
  const auto scan = read_row({0, 1, 2, 3, 4, 5, 6, 0});
  ASSERT_TRUE(scan.ok());
  EXPECT_EQ(std::get<ScanFile>(*scan).evidence, "its 6 values change from voxel to voxel");
  const auto negative = read_row({-1, 1, 1, 1});
  ASSERT_TRUE(negative.ok());
  EXPECT_NE(std::get<ScanFile>(*negative).evidence.find("other than whole numbers"), std::string::npos);

  std::vector<int> stairs;
  for (int n = 0; n < 800; ++n) stairs.push_back(1 + n / 8);
  const auto unclear = read_row(stairs);
  ASSERT_FALSE(unclear.ok());
  const std::string file = (folder / "row.nrrd").string();
  EXPECT_NE(unclear.error().what.find("may be a label map or a scan: its 100 values"), std::string::npos);
  EXPECT_NE(unclear.error().remedy.find("--labels " + file), std::string::npos) << unclear.error().message();
  EXPECT_NE(unclear.error().remedy.find("--scan " + file), std::string::npos);

  // an explicit declaration takes precedence over the evidence
  set_read_as(ReadAs::kLabels);
  EXPECT_TRUE(std::holds_alternative<LabelFile>(*read_row(stairs)));
  EXPECT_TRUE(std::holds_alternative<LabelFile>(*read_row({0, 1, 2, 3, 4, 5, 6, 0})));
  set_read_as(ReadAs::kScan);
  EXPECT_TRUE(std::holds_alternative<ScanFile>(*read_row(stairs)));
  EXPECT_TRUE(std::holds_alternative<ScanFile>(*read_row({0, 1, 1, 1, 2, 2, 2, 0})));
  set_read_as(ReadAs::kByContent);
}

// a fine atlas changes from voxel to voxel: its table declares it as labels
TEST(ReadVolume, TableInTheSameFolderMarksLabels) {
  const TemporaryFolder folder;
  std::vector<int> fine;
  for (int n = 0; n < 300; ++n) fine.push_back(1 + n * 13 % 4100);
  std::string table;
  for (const int value : fine)
    table += std::to_string(value) + " gyrus_" + std::to_string(value) + " 1 2 3 255\n";
  const auto file = write_row(folder, fine);
  const auto is_labels = [&] {
    const auto volume = read_volume(file);
    EXPECT_TRUE(volume.ok()) << volume.error().message();
    return volume.ok() && std::holds_alternative<LabelFile>(*volume);
  };
  EXPECT_FALSE(is_labels());
  write_text(folder / "row.ctbl", table);
  ASSERT_TRUE(is_labels());
  const auto labels = std::get<LabelFile>(*read_volume(file));
  EXPECT_NE(labels.evidence.find("row.ctbl names 300 of its 300 values"), std::string::npos)
      << labels.evidence;
  EXPECT_EQ(labels.name_source, NameSource::kOwnTable);
  EXPECT_TRUE(labels.unnamed.empty());

  // a table of another name must name every value
  std::filesystem::rename(folder / "row.ctbl", folder / "gyri.ctbl");
  EXPECT_TRUE(is_labels());
  write_text(folder / "gyri.ctbl", table.substr(0, table.find('\n', table.size() / 2) + 1));
  EXPECT_FALSE(is_labels());
}

// ids that are equal as floats are distinguished
TEST(ReadVolume, LabelsAbove65535AreRefusedWithTheirNumber) {
  const TemporaryFolder folder;
  const auto write_ids = [&](const std::string& values, int count) {
    return write_text(folder / "ids.nrrd",
                      nrrd("uint32", std::to_string(count) + " 1 1", "encoding: ascii\n", values));
  };
  const auto file = write_ids("0 614454277 614454277 614454278 614454278 3 3 0", 8);
  for (const auto& error : {read_labels(file).error(), read_volume(file).error()}) {
    EXPECT_NE(error.what.find("has 2 labels above 65535 (614454277, 614454278)"), std::string::npos)
        << error.message();
    EXPECT_NE(error.remedy.find("--scan"), std::string::npos);
  }
  EXPECT_TRUE(read_scan(file).ok());
  EXPECT_NE(read_labels(write_ids("0 65536 65536 1", 4)).error().what.find("has 1 label above 65535 (65536)"),
            std::string::npos);
  // a 32-bit scan changes from voxel to voxel
  const auto scan = read_volume(write_ids("70000 70010 70020 69000 68000 1", 6));
  ASSERT_TRUE(scan.ok()) << scan.error().message();
  EXPECT_TRUE(std::holds_alternative<ScanFile>(*scan));
}

// ---- NIfTI with two transforms ------------------------------------------------------------------

// 4 x 3 x 2 voxels of 1 mm, with an sform that is RAS; both codes are set
std::string nifti_of_two_forms(float quaternion_c, float qoffset_x, float handedness) {
  std::string bytes(352 + 4 * 3 * 2 * 2, '\0');
  const auto put = [&](std::size_t at, auto value) { std::memcpy(bytes.data() + at, &value, sizeof value); };
  put(0, std::int32_t{348});
  const std::int16_t dims[] = {3, 4, 3, 2, 1, 1, 1, 1};
  for (std::size_t a = 0; a < 8; ++a) put(40 + 2 * a, dims[a]);
  put(70, std::int16_t{4});
  put(72, std::int16_t{16});
  put(76, handedness);
  for (std::size_t a = 1; a < 4; ++a) put(76 + 4 * a, 1.f);
  put(108, 352.f);
  bytes[123] = 2;
  put(252, std::int16_t{1});
  put(254, std::int16_t{1});
  put(260, quaternion_c);
  put(268, qoffset_x);
  for (std::size_t a = 0; a < 3; ++a) put(280 + 20 * a, 1.f);
  std::memcpy(bytes.data() + 344, "n+1", 4);
  for (std::int16_t n = 0; n < 24; ++n) put(352 + 2 * static_cast<std::size_t>(n), n);
  return bytes;
}

TEST(NiftiForms, WarnsIfTheFormsDiffer) {
  const TemporaryFolder folder;
  const auto warnings_of = [&](const std::string& bytes) {
    std::string warnings;
    const auto file = write_text(folder / "a.nii", bytes);
    const auto scan = read_scan(file, {}, [&](const std::string& text) { warnings += text; });
    EXPECT_TRUE(scan);
    EXPECT_EQ(scan->header.placement_doubt.empty(), warnings.empty());
    return warnings;
  };
  const std::string mirrored = warnings_of(nifti_of_two_forms(0, 0, -1));
  EXPECT_NE(mirrored.find("a qform and an sform that differ by a mirror"), std::string::npos) << mirrored;
  EXPECT_NE(mirrored.find("by the sform, which is used, its axes are RAS"), std::string::npos) << mirrored;
  EXPECT_NE(mirrored.find("by the qform its axes are RAI"), std::string::npos) << mirrored;
  EXPECT_NE(mirrored.find("--form q or s"), std::string::npos) << mirrored;
  const std::string shifted = warnings_of(nifti_of_two_forms(0, 20, 1));
  EXPECT_NE(shifted.find("differ by up to 20.0 mm"), std::string::npos) << shifted;
  // half a voxel is rounding by the writer
  EXPECT_EQ(warnings_of(nifti_of_two_forms(0, 0.5f, 1)), "");
}

TEST(NiftiForms, TheOneThatIsAskedForIsRead) {
  const TemporaryFolder folder;
  const auto file = write_text(folder / "a.nii", nifti_of_two_forms(0, 20, -1));
  const auto as = [&](NiftiForm form) {
    PlacementOptions placement_options;
    placement_options.nifti_form = form;
    std::string warnings;
    const auto scan = read_scan(
        file, {}, [&](const std::string& text) { warnings += text; }, VoxelCaching::kOff, {},
        placement_options);
    EXPECT_TRUE(scan);
    EXPECT_EQ(warnings, "");
    return scan->scan.geometry();
  };
  EXPECT_EQ(axis_codes(as(NiftiForm::kSform).direction), "RAS");
  EXPECT_EQ(as(NiftiForm::kSform).origin.x(), 0);
  EXPECT_EQ(axis_codes(as(NiftiForm::kQform).direction), "RAI");
  EXPECT_EQ(as(NiftiForm::kQform).origin.x(), -20);
}

}  // namespace
}  // namespace palpate
