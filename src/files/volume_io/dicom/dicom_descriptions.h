#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "volume_io/dicom/dicom_volumes.h"

/// Descriptions of DICOM volumes for the user. They contain no text from the files, as dicom_volumes.h.
namespace palpate::volume_io {

/// Text of a length with two decimals, "-12.50"; never "-0.00".
std::string in_mm(double value);
/// Text of a number with at most four significant digits.
std::string short_number(double value);
/// "1 image", "5 images"
std::string images_in_words(std::size_t count);

/// Description of a volume by itself: "series 1: CT, axial, 512 x 512 x 90, 0.7 x 0.7 x 1.25 mm".
/// @param geometry  default-constructed if the volume cannot be used; its slice distance is then left out
std::string description_of(const std::vector<DicomFrame>& frames, const GridGeometry& geometry);

/// Attributes by which a volume differs from others of its series: ", echo time 20 ms, magnitude"; empty if
/// there are none.
/// @param of_series  an image of each volume of the series
std::string distinguishing_attributes(const std::vector<DicomFrame>& frames,
                                      const std::vector<const DicomFrame*>& of_series);

}  // namespace palpate::volume_io
