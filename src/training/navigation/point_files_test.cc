#include "palpate/navigation/point_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate {
namespace {

using ::testing::HasSubstr;

std::string refused_points(std::string_view text) {
  const auto points = parse_points(text, "points.csv");
  return points ? "accepted" : points.error().message();
}

TEST(ParsePoints, LinesOfAnyKind) {
  for (const char* text :
       {"a,1,2,-3.5\nb,4,5,6\n", "a 1 2 -3.5\r\n\r\nb\t4 5 6", "label;x;y;z\na;1;2;-3.5\nb;4;5;6;\n",
        "# mine\nname, x, y, z\na, 1, 2, -3.5\n b , 4 , 5 , +6"}) {
    SCOPED_TRACE(text);
    const auto points = parse_points(text, "points.csv");
    ASSERT_TRUE(points) << points.error().message();
    ASSERT_EQ(points->size(), 2u);
    EXPECT_EQ((*points)[0].name, "a");
    EXPECT_EQ((*points)[0].at_mm, Eigen::Vector3d(1, 2, -3.5));
    EXPECT_EQ((*points)[1].name, "b");
    EXPECT_EQ((*points)[1].at_mm, Eigen::Vector3d(4, 5, 6));
    EXPECT_FALSE((*points)[1].fle_mm);
  }
  const auto unnamed = parse_points("1 2 3\nb 4 5 6 0.5\n7,7,8,9,0.25\n8 1 2 3", "points.csv");
  ASSERT_TRUE(unnamed) << unnamed.error().message();
  EXPECT_EQ((*unnamed)[0].name, "1");
  EXPECT_EQ((*unnamed)[1].fle_mm, 0.5);
  // a name may be a number
  EXPECT_EQ((*unnamed)[2].name, "7");
  EXPECT_EQ((*unnamed)[2].at_mm, Eigen::Vector3d(7, 8, 9));
  EXPECT_EQ((*unnamed)[3].name, "8");
  EXPECT_EQ((*unnamed)[3].at_mm, Eigen::Vector3d(1, 2, 3));
}

TEST(ParsePoints, OfSlicer) {
  const auto json =
      parse_points(R"({"markups": [{"type": "Fiducial", "coordinateSystem": "RAS", "controlPoints": [
    {"label": "F-1", "position": [1, 2, 3], "positionStatus": "defined"},
    {"label": "F-2", "position": [0, 0, 0], "positionStatus": "undefined"}, {"position": [4.5, 5, 6]}]}]})",
                   "f.mrk.json");
  ASSERT_TRUE(json) << json.error().message();
  ASSERT_EQ(json->size(), 2u);
  EXPECT_EQ((*json)[0].name, "F-1");
  EXPECT_EQ((*json)[0].at_mm, Eigen::Vector3d(-1, -2, 3));
  EXPECT_EQ((*json)[1].name, "2");
  const char* rows =
      "# columns = "
      "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\nvtkMRMLMarkupsFiducialNode_0,1,2,3,0,0,"
      "0,1,1,1,0,F-1,,\n";
  const auto lps = parse_points(
      std::string("# Markups fiducial file version = 4.11\n# CoordinateSystem = LPS\n") + rows, "f.fcsv");
  ASSERT_TRUE(lps) << lps.error().message();
  EXPECT_EQ((*lps)[0].name, "F-1");
  EXPECT_EQ((*lps)[0].at_mm, Eigen::Vector3d(1, 2, 3));
  const auto ras = parse_points(
      std::string("# Markups fiducial file version = 4.10\n# CoordinateSystem = 0\n") + rows, "f.fcsv");
  ASSERT_TRUE(ras);
  EXPECT_EQ((*ras)[0].at_mm, Eigen::Vector3d(-1, -2, 3));
}

TEST(ParseMarkups, DistinguishesMarkupTypes) {
  const auto markups = parse_markups(R"({"markups": [
    {"type": "Line", "name": "L", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": [
      {"label": "L-1", "position": [1, 2, 3], "positionStatus": "defined"},
      {"label": "L-2", "position": [4, 5, 6]}]},
    {"type": "Fiducial", "coordinateSystem": "RAS", "coordinateUnits": ["mm", "UCUM", "millimeter"],
     "controlPoints": [{"position": [7, 8, 9]}, {"label": "x", "position": [0, 0, 0], "positionStatus": "preview"}]},
    {"type": "ROI", "center": [0, 0, 0]}]})",
                                     "m.mrk.json");
  ASSERT_TRUE(markups) << markups.error().message();
  ASSERT_EQ(markups->size(), 3u);
  EXPECT_EQ((*markups)[0].type, "Line");
  EXPECT_EQ((*markups)[0].name, "L");
  ASSERT_EQ((*markups)[0].points.size(), 2u);
  EXPECT_EQ((*markups)[0].points[1].at_mm, Eigen::Vector3d(4, 5, 6));
  ASSERT_EQ((*markups)[1].points.size(), 1u);
  EXPECT_EQ((*markups)[1].points[0].name, "3");
  EXPECT_EQ((*markups)[1].points[0].at_mm, Eigen::Vector3d(-7, -8, 9));
  EXPECT_EQ((*markups)[2].type, "ROI");
  EXPECT_TRUE((*markups)[2].points.empty());

  const char* in_metres =
      R"({"markups": [{"type": "Line", "coordinateUnits": "m", "controlPoints": [{"position": [1, 2, 3]}]}]})";
  for (const auto& refused :
       {parse_markups(in_metres, "m.mrk.json").error().message(), refused_points(in_metres)})
    EXPECT_THAT(refused, testing::AllOf(HasSubstr("in m\n"), HasSubstr("millimetres")));
}

TEST(ParsePoints, RefusesByTheLine) {
  EXPECT_THAT(refused_points(""), HasSubstr("has no point"));
  EXPECT_THAT(refused_points("name,x,y,z\n"), HasSubstr("has no point"));
  EXPECT_THAT(refused_points("a,1,2,3\nb,4,5\n"), HasSubstr("points.csv:2: is not a point"));
  EXPECT_THAT(refused_points("a,1,2,nan\n"), HasSubstr("points.csv:1: is not a point"));
  EXPECT_THAT(refused_points("a,1,2,3,0\n"), HasSubstr("error must be above 0"));
  EXPECT_THAT(refused_points("# CoordinateSystem = XYZ\n"), HasSubstr("\"XYZ\""));
  EXPECT_THAT(refused_points("{"), HasSubstr("not a JSON file"));
  EXPECT_THAT(refused_points("{\"markups\": []}"), HasSubstr("no markups"));
  EXPECT_THAT(refused_points(R"({"markups": [{"controlPoints": [{"position": [1, 2]}]}]})"),
              HasSubstr("three numbers"));
  EXPECT_THAT(refused_points(R"({"markups": [{"controlPoints": []}]})"), HasSubstr("no placed point"));
}

TEST(ParsePoses, MatricesAndQuaternions) {
  for (const auto& [text, scalar_first] :
       {std::pair("0 -1 0 5 1 0 0 6 0 0 1 7 0 0 0 1", false), std::pair("0,-1,0,5,1,0,0,6,0,0,1,7\n", false),
        std::pair("x y z qx qy qz qw\n5 6 7 0 0 0.70710678 0.70710678", false),
        std::pair("5 6 7 0.70710678 0 0 0.70710678", true)}) {
    SCOPED_TRACE(text);
    const auto poses = parse_poses(text, "poses.txt", {"", scalar_first});
    ASSERT_TRUE(poses) << poses.error().message();
    ASSERT_EQ(poses->size(), 1u);
    const Point<Tracker> at = poses->front() * Point<TrackedTool>(1, 0, 0);
    EXPECT_LT((at - Point<Tracker>(5, 7, 7)).norm(), 1e-7);
  }
  const auto refused = [](std::string_view text, const PoseFormat& format = {}) {
    const auto poses = parse_poses(text, "poses.txt", format);
    return poses ? "accepted" : poses.error().message();
  };
  EXPECT_THAT(refused("1 2 3 4\n"), HasSubstr("poses.txt:1: is not a pose"));
  EXPECT_THAT(refused("1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 2\n"), HasSubstr("is not a pose"));
  EXPECT_THAT(refused("1 2 3 0 0 0 2\n"), HasSubstr("unit quaternion"));
  EXPECT_THAT(refused("\n# nothing\n"), HasSubstr("has no pose"));
}

TEST(ParsePoses, SequencesOfPlus) {
  const std::string text =
      "ObjectType = Image\nSeq_Frame0000_StylusToTrackerTransform = 1 0 0 5 0 1 0 6 0 0 1 7 0 0 0 1\n"
      "Seq_Frame0000_StylusToTrackerTransformStatus = OK\n"
      "Seq_Frame0001_StylusToTrackerTransform = 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 "
      "1\nSeq_Frame0001_StylusToTrackerTransformStatus = INVALID\n"
      "Seq_Frame0000_ProbeToTrackerTransform = 1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1\nElementDataFile = "
      "LOCAL\n\xff\xfe = \n";
  const auto poses = parse_poses(text, "s.mha", {"StylusToTracker", false});
  ASSERT_TRUE(poses) << poses.error().message();
  ASSERT_EQ(poses->size(), 1u);
  EXPECT_EQ(poses->front().translation(), Eigen::Vector3d(5, 6, 7));
  EXPECT_THAT(parse_poses(text, "s.mha").error().message(), HasSubstr("ProbeToTracker, StylusToTracker"));
  EXPECT_THAT(parse_poses(text, "s.mha", {"Needle", false}).error().message(),
              HasSubstr("it has: ProbeToTracker"));
}

}  // namespace
}  // namespace palpate
