// All of isobrick but its pictures: open, query and build pyramids, read volumes of all formats,
// and stream surfaces to an interface.
//
// Begin with Pyramid and Extractor if there is a pyramid, and with openVolume() and buildPyramid()
// if there is none. A program may bring a VolumeSource and a TriangleSink of its own. The programs
// in `examples/` show all of these.
//
// A program links the libraries that it uses: isobrick::storage, extract, preprocess, sources,
// export and view. A header that is not included here belongs to the library itself, and may change
// at any time; but pictures are written with `isobrick/viewer/image.h`.
#pragma once

#include "isobrick/extract/color_map.h"
#include "isobrick/extract/extractor.h"
#include "isobrick/extract/mesh_check.h"
#include "isobrick/extract/mesh_distance.h"
#include "isobrick/extract/one_pass_surface.h"
#include "isobrick/extract/pyramid_values.h"
#include "isobrick/extract/query_box.h"
#include "isobrick/extract/read_mesh_file.h"
#include "isobrick/extract/shares/mesh_share.h"
#include "isobrick/extract/sinks/indexed_mesh.h"
#include "isobrick/extract/sinks/mesh_collection.h"
#include "isobrick/extract/sinks/mesh_file_sink.h"
#include "isobrick/extract/sinks/surface_components.h"
#include "isobrick/extract/sinks/vertex_numbering.h"
#include "isobrick/extract/wall_thickness.h"
#include "isobrick/preprocess/brick_stream.h"
#include "isobrick/preprocess/divided_pyramid.h"
#include "isobrick/preprocess/export/formats/export_volume.h"
#include "isobrick/preprocess/phantoms/phantom.h"
#include "isobrick/preprocess/pyramid_builder.h"
#include "isobrick/preprocess/sources/indexed_source.h"
#include "isobrick/preprocess/sources/open_volume.h"
#include "isobrick/preprocess/value_fit.h"
#include "isobrick/storage/isovalue_suggestions.h"
#include "isobrick/storage/pyramid_file.h"
#include "isobrick/storage/pyramid_verify.h"
#include "isobrick/viewer/stream/merged_surface.h"
