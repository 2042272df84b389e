#pragma once

#include <string>

#include "volume_io/dicom/dicom_segments.h"

/// Names, types and colours of the segments of a DICOM segmentation. Plain data, as dicom_volumes.h.
namespace palpate::volume_io {

/// Display name of a segment: its label, or its type if that is known and the label does not contain it; with
/// its side.
std::string name_of_segment(const DicomSegment& segment);
/// Segment description by name only: code, scheme and meaning if the name is one of palpate's types with a
/// SNOMED CT code, and its side.
DicomSegment segment_from_name(const std::string& name);
/// Colour as in Slicer's fields, "0.87 0.68 0.51", converted from CIELab with illuminant D65 (DICOM PS3.3
/// C.10.7.1.1), or from the palette; empty if the segment has neither.
std::string colour_of_segment(const DicomSegment& segment);
/// True for a segment that represents the background (code 125040 of DCM).
bool is_background(const DicomSegment& segment);

}  // namespace palpate::volume_io
