# What programs include as <isobrick/...>; <isobrick/isobrick.h> includes all of the libraries that are
# installed, but for the viewer's. A header in this list includes none that is not in it. Everything else is
# free to change.
set(isobrick_public_headers
  isobrick.h
  # what a pyramid is
  storage/brick_layout.h
  storage/error.h
  storage/grid.h
  storage/isovalue_suggestions.h
  storage/length_scale.h
  storage/pyramid.h
  storage/pyramid_file.h
  storage/pyramid_info.h
  storage/pyramid_verify.h
  storage/remote_options.h
  storage/share_number.h
  storage/source_bricks.h
  storage/value_transform.h
  storage/voxel_histogram.h
  storage/voxel_type.h
  # a pyramid in, triangles out
  extract/color_map.h
  extract/extractor.h
  extract/mesh_check.h
  extract/mesh_distance.h
  extract/one_pass_surface.h
  extract/pyramid_values.h
  extract/query.h
  extract/query_box.h
  extract/read_mesh_file.h
  extract/shares/mesh_share.h
  extract/sinks/component_choice.h
  extract/sinks/indexed_mesh.h
  extract/sinks/mesh_collection.h
  extract/sinks/mesh_file_sink.h
  extract/sinks/triangle_sink.h
  extract/sinks/surface_components.h
  extract/sinks/vertex_numbering.h
  extract/surface_mesh.h
  extract/surface_region.h
  extract/wall_thickness.h
  # a pyramid in, chunks of surfaces out, pass by pass, beside an interface
  viewer/stream/merged_surface.h
  viewer/stream/surface_chunk.h
  viewer/stream/surface_stream.h
  # a volume in, a pyramid out; and volumes to other formats
  preprocess/brick_stream.h
  preprocess/derived_volume.h
  preprocess/divided_pyramid.h
  preprocess/export/formats/export_volume.h
  preprocess/export/volume_writer.h
  preprocess/phantoms/phantom.h
  preprocess/pyramid_builder.h
  preprocess/sources/indexed_source.h
  preprocess/sources/open_volume.h
  preprocess/value_fit.h
  preprocess/volume_source.h)
if(ISOBRICK_WITH_VIEWER)
  list(APPEND isobrick_public_headers
    viewer/image.h)
endif()
