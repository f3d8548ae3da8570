// The interface of the paper (Sect. 6): a surface of a pyramid as a shape node of an Open Inventor
// scene graph. A node beside it says where it is fine, and Inventor's own clip planes cut it:
// change them, and the surface is extracted again when the graph is next traversed.
#include <Inventor/SoPrimitiveVertex.h>
#include <Inventor/actions/SoCallbackAction.h>
#include <Inventor/actions/SoGLRenderAction.h>
#include <Inventor/elements/SoClipPlaneElement.h>
#include <Inventor/elements/SoReplacedElement.h>
#include <Inventor/fields/SoSFVec3f.h>
#include <Inventor/nodes/SoClipPlane.h>
#include <Inventor/nodes/SoSeparator.h>
#include <Inventor/nodes/SoShape.h>
#include <isobrick/isobrick.h>

#include <cstdio>

using namespace isobrick;

SbVec3f toInventor(const glm::vec3& v) { return {v.x, v.y, v.z}; }
glm::dvec3 toGlm(const SbVec3f& v) { return {v[0], v[1], v[2]}; }

// The sphere of interest, for all surfaces behind it in the graph; in the world.
class FocusElement : public SoReplacedElement {
  SO_ELEMENT_HEADER(FocusElement);

 public:
  static void initClass() { SO_ELEMENT_INIT_CLASS(FocusElement, SoReplacedElement); }
  void init(SoState*) override { radius = -1; }
  SbVec3f center;
  float radius = -1;  // below 0: none
};
SO_ELEMENT_SOURCE(FocusElement);
class SoFocus : public SoNode {
  SO_NODE_HEADER(SoFocus);

 public:
  static void initClass() {
    SO_NODE_INIT_CLASS(SoFocus, SoNode, "Node");
    SO_ENABLE(SoCallbackAction, FocusElement);
    SO_ENABLE(SoGLRenderAction, FocusElement);
  }
  SoFocus() {
    SO_NODE_CONSTRUCTOR(SoFocus);
    SO_NODE_ADD_FIELD(center, (0, 0, 0));
    SO_NODE_ADD_FIELD(radius, (10));
  }
  SoSFVec3f center;
  SoSFFloat radius;

  void doAction(SoAction* action) override {
    auto* const element = static_cast<FocusElement*>(
        action->getState()->getElement(FocusElement::getClassStackIndex()));
    element->center = center.getValue();
    element->radius = radius.getValue();
  }
  void GLRender(SoGLRenderAction* action) override { doAction(action); }
  void callback(SoCallbackAction* action) override { doAction(action); }
};
SO_NODE_SOURCE(SoFocus);
class SoIsosurface : public SoShape {
  SO_NODE_HEADER(SoIsosurface);

 public:
  static void initClass() { SO_NODE_INIT_CLASS(SoIsosurface, SoShape, "Shape"); }
  SoIsosurface() {
    SO_NODE_CONSTRUCTOR(SoIsosurface);
    SO_NODE_ADD_FIELD(isovalue, (0));
  }
  SoSFFloat isovalue;

  const SurfaceMesh& mesh() const { return mesh_; }
  void show(const Pyramid& pyramid) {
    extractor_ = std::make_unique<Extractor>(*(pyramid_ = &pyramid));
  }

 protected:
  void generatePrimitives(SoAction* action) override {
    extractor_->extract(queryOf(action->getState()), mesh_);
    SoPrimitiveVertex vertex;
    beginShape(action, TRIANGLES);
    for (const std::uint32_t v : mesh_.triangles()) {
      vertex.setPoint(toInventor(mesh_.worldPosition(v)));
      vertex.setNormal(toInventor(mesh_.normals()[v]));
      shapeVertex(&vertex);
    }
    endShape();
  }
  void computeBBox(SoAction*, SbBox3f& box, SbVec3f& center) override {
    for (const glm::dvec3& at : worldCorners(pyramid_->spec().geometry, pyramid_->spec().voxels))
      box.extendBy(toInventor(at));
    center = box.getCenter();
  }

 private:
  Query queryOf(SoState* state) const {
    const GridGeometry& geometry = pyramid_->spec().geometry;
    Query query;
    query.isovalue = isovalue.getValue();
    const auto* const focus = static_cast<const FocusElement*>(
        state->getConstElement(FocusElement::getClassStackIndex()));
    if (focus->radius >= 0)
      query.focus = FocusSphere{geometry.worldToIndex(toGlm(focus->center)),
                                focus->radius / geometry.leastSpacing()};
    const auto* const planes = SoClipPlaneElement::getInstance(state);
    for (int i = 0; i < planes->getNum(); ++i) {
      const SbPlane& plane = planes->get(i, FALSE);  // what lies on the side of its normal stays
      query.region.half_spaces.push_back(
          halfSpaceInWorld(geometry, toGlm(plane.getNormal()), plane.getDistanceFromOrigin()));
    }
    query.cap = focus->radius < 0;  // caps of planes need the finest level
    return query;
  }

  const Pyramid* pyramid_ = nullptr;
  std::unique_ptr<Extractor> extractor_;
  SurfaceMesh mesh_;
};
SO_NODE_SOURCE(SoIsosurface);

int main() {
  SoDB::init();
  FocusElement::initClass();
  SoFocus::initClass();
  SoIsosurface::initClass();
  buildPyramid(*makePhantomSource({.name = "head", .size = 128}), "head.isb", {});
  const Pyramid pyramid("head.isb");
  auto* const root = new SoSeparator;
  root->ref();
  auto* const surface = new SoIsosurface;
  surface->isovalue = 1324;
  surface->show(pyramid);
  root->addChild(surface);
  SoCallbackAction viewer;  // stands for one
  viewer.addTriangleCallback(
      SoShape::getClassTypeId(), [](auto*...) {}, nullptr);
  const auto tell = [&](const char* what) {
    viewer.apply(root);
    std::printf("%s: %zu triangles\n", what, surface->mesh().triangles().size() / 3);
  };
  tell("whole");
  auto* const clip = new SoClipPlane;
  clip->plane = SbPlane(SbVec3f(1, 0, 0), 64);
  root->insertChild(clip, 0);
  tell("half of it, closed");
  auto* const focus = new SoFocus;
  focus->center.setValue(75, 30, 75);
  root->insertChild(focus, 1);
  tell("around the focus");
  root->unref();
}
