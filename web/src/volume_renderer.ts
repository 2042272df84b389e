// vtk.js draws the colour field by ray casting, off screen: the picture is copied from here. vtk.js wants an interactor
// even where nobody interacts with it: its volume mapper asks it whether something is being animated.

import "@kitware/vtk.js/Rendering/OpenGL/Profiles/Volume";
import vtkColorTransferFunction from "@kitware/vtk.js/Rendering/Core/ColorTransferFunction";
import vtkDataArray from "@kitware/vtk.js/Common/Core/DataArray";
import vtkImageData from "@kitware/vtk.js/Common/DataModel/ImageData";
import vtkOpenGLRenderWindow from "@kitware/vtk.js/Rendering/OpenGL/RenderWindow";
import vtkPiecewiseFunction from "@kitware/vtk.js/Common/DataModel/PiecewiseFunction";
import vtkRenderer from "@kitware/vtk.js/Rendering/Core/Renderer";
import vtkRenderWindow from "@kitware/vtk.js/Rendering/Core/RenderWindow";
import vtkRenderWindowInteractor from "@kitware/vtk.js/Rendering/Core/RenderWindowInteractor";
import vtkVolume from "@kitware/vtk.js/Rendering/Core/Volume";
import vtkVolumeMapper from "@kitware/vtk.js/Rendering/Core/VolumeMapper";
import type { Camera } from "./camera.js";
import type { ColourField } from "./field.js";

/** Behind everything, 0 ... 1. */
export const BACKGROUND: [number, number, number] = [9 / 255, 12 / 255, 14 / 255];

export class VolumeRenderer {
  readonly canvas: HTMLCanvasElement;
  /** The graphics are computed by the processor: pictures take a hundred times as long. */
  readonly isSoftware: boolean;
  private readonly view = vtkOpenGLRenderWindow.newInstance();
  private readonly window = vtkRenderWindow.newInstance();
  private readonly renderer = vtkRenderer.newInstance({ background: BACKGROUND });
  private readonly mapper = vtkVolumeMapper.newInstance();
  private readonly volume = vtkVolume.newInstance();
  private image: ReturnType<typeof vtkImageData.newInstance> | null = null;
  private readonly gl: WebGL2RenderingContext;
  private readonly pixel = new Uint8Array(4);
  private size = "";

  constructor() {
    this.window.addRenderer(this.renderer);
    this.window.addView(this.view);
    this.view.setSize(64, 64);
    const interactor = vtkRenderWindowInteractor.newInstance();
    interactor.setView(this.view);
    interactor.initialize();
    this.canvas = this.view.getCanvas() as HTMLCanvasElement;
    this.gl = this.canvas.getContext("webgl2") as WebGL2RenderingContext;
    const info = this.gl.getExtension("WEBGL_debug_renderer_info");
    const name = String(info ? this.gl.getParameter(info.UNMASKED_RENDERER_WEBGL) : "");
    this.isSoftware = /swiftshader|llvmpipe|software/i.test(name);

    this.mapper.setAutoAdjustSampleDistances(false);
    this.mapper.setMaximumSamplesPerRay(4000);
    this.volume.setMapper(this.mapper);
    const property = this.volume.getProperty();
    property.setIndependentComponents(false);
    property.setInterpolationTypeToLinear();
    const grey = vtkColorTransferFunction.newInstance();
    grey.addRGBPoint(0, 0, 0, 0);
    grey.addRGBPoint(255, 1, 1, 1);
    property.setRGBTransferFunction(0, grey);
    // alpha to opacity a millimetre: the scan's haze below 36, a surface where a structure covers half a voxel
    const opacity = vtkPiecewiseFunction.newInstance();
    for (const [alpha, value] of [[0, 0], [3, 0], [36, 0.03], [100, 0.04], [114, 0.2], [128, 0.7], [150, 0.95], [255, 1]]) {
      opacity.addPoint(alpha!, value!);
    }
    property.setScalarOpacity(0, opacity);
    property.setScalarOpacityUnitDistance(0, 1);
    property.setAmbient(0.28);
    property.setDiffuse(0.68);
    property.setSpecular(0.08);
    property.setSpecularPower(20);
    property.setShade(true);
  }

  load(field: ColourField): void {
    const isFirst = this.image === null;
    const image = vtkImageData.newInstance();
    image.setDimensions(field.dims);
    image.setOrigin(field.origin);
    image.setSpacing(field.spacing);
    image.setDirection(...(field.direction.flat() as [number, number, number, number, number, number, number, number, number]));
    image.getPointData().setScalars(vtkDataArray.newInstance({ numberOfComponents: 4, values: field.rgba }));
    this.mapper.setInputData(image);
    this.mapper.setSampleDistance(Math.min(...field.spacing) * (this.isSoftware ? 1 : 0.6));
    this.image = image;
    if (isFirst) this.renderer.addVolume(this.volume);
  }

  /**
   * @param reduction  of the picture's sides
   * @returns how long it took, ms
   */
  render(camera: Camera, width: number, height: number, reduction: number): number {
    const before = performance.now();
    const w = Math.max(16, Math.round(width / reduction));
    const h = Math.max(16, Math.round(height / reduction));
    if (this.size !== `${w}x${h}`) {
      this.size = `${w}x${h}`;
      this.view.setSize(w, h);
    }
    const eye = this.renderer.getActiveCamera();
    const { position, focus, up } = camera.inPatient();
    eye.setParallelProjection(true);
    eye.setPosition(...position);
    eye.setFocalPoint(...focus);
    eye.setViewUp(up);
    eye.setParallelScale((camera.mmPerPixel * height) / 2);
    this.renderer.resetCameraClippingRange();
    this.window.render();
    // reading a pixel waits for the picture
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, this.pixel);
    return performance.now() - before;
  }
}
