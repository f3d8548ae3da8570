#include "isobrick/viewer/graphics_report.h"

#include "isobrick/viewer/egl_context.h"
#include "isobrick/viewer/render/gl_device.h"

namespace isobrick {

GraphicsReport graphicsReport() {
  const EglContext context;
  const EglContext::CurrentScope current(context);
  const GlDevice device;
  GraphicsReport report;
  report.device = device.name();
  report.vendor = device.vendor();
  report.version = device.version();
  report.is_software = device.isSoftware();
  report.place = context.placeName();
  for (const EglPlace& place : eglPlaces()) report.places.push_back({place.name, place.about});
  report.limits = device.limits().rows();
  report.switched_off = device.limits().consequences();
  return report;
}

}  // namespace isobrick
