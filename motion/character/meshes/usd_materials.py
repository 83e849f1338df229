"""Materials of glTF as USD's preview surfaces, which hold all that glTF's own materials do.

Source: Pixar, UsdPreviewSurface Specification, OpenUSD documentation.
"""

from collections.abc import Sequence
from typing import Any

from muybridge.motion.character.meshes.static_mesh import Look, Picture

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}  # numbers of glTF
_SUFFIXES = {"image/png": ".png", "image/jpeg": ".jpg", "image/webp": ".webp", "image/ktx2": ".ktx2"}


def picture_files(pictures: Sequence[Picture]) -> list[str]:
    """A file name for each picture, no two the same."""
    out: list[str] = []
    for k, picture in enumerate(pictures):
        suffix = _SUFFIXES.get(picture.kind, "")
        base = picture.name.removesuffix(suffix).replace("/", "_").replace("\\", "_") or f"image_{k}"
        out.append(f"{base}{suffix}" if f"{base}{suffix}" not in out else f"{base}_{k}{suffix}")
    return out


def add_materials(stage: Any, above: str, look: Look, folder: str) -> list[Any]:
    """A material for each of a mesh's.

    Args:
        stage: to add to.
        above: path of the prim that they go below.
        look: of the mesh.
        folder: with the pictures, as the stage names it.

    Returns:
        The materials.
    """
    from pxr import Sdf, Tf, UsdShade

    files = [f"{folder}/{name}" for name in picture_files(look.pictures)]
    out = []
    for k, raw in enumerate(look.materials):
        name = str(raw.get("name") or f"material_{k}")
        path = f"{above}/{Tf.MakeValidIdentifier(name)}"
        while stage.GetPrimAtPath(path):
            path += "_"
        material = UsdShade.Material.Define(stage, path)
        material.GetPrim().SetMetadata("displayName", name)
        surface = _Surface(stage, path, look, files)
        surface.fill(raw)
        material.CreateSurfaceOutput().ConnectToSource(surface.shader.CreateOutput("surface", Sdf.ValueTypeNames.Token))
        out.append(material)
    return out


class _Surface:
    """A preview surface and the textures that it reads."""

    def __init__(self, stage: Any, path: str, look: Look, files: list[str]) -> None:
        from pxr import UsdShade

        self.stage, self.path, self.look, self.files = stage, path, look, files
        self.shader = UsdShade.Shader.Define(stage, f"{path}/surface")
        self.shader.CreateIdAttr("UsdPreviewSurface")

    def fill(self, raw: dict[str, Any]) -> None:
        """Set all inputs as a material of glTF has them."""
        look = raw.get("pbrMetallicRoughness") or {}
        colour = [float(v) for v in look.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0))]
        base = self._texture("base", look.get("baseColorTexture"), True, colour)
        self._input("diffuseColor", "Color3f", colour[:3], base, "rgb")
        mode = raw.get("alphaMode", "OPAQUE")
        if mode != "OPAQUE":
            self._input("opacity", "Float", colour[3], base, "a")
            if mode == "MASK":
                self._input("opacityThreshold", "Float", float(raw.get("alphaCutoff", 0.5)))
        rough, metal = float(look.get("roughnessFactor", 1.0)), float(look.get("metallicFactor", 1.0))
        both = self._texture("metal_and_roughness", look.get("metallicRoughnessTexture"), False, [1, rough, metal, 1])
        self._input("roughness", "Float", rough, both, "g")
        self._input("metallic", "Float", metal, both, "b")
        glow = [float(v) for v in raw.get("emissiveFactor", (0.0, 0.0, 0.0))]
        self._input("emissiveColor", "Color3f", glow,
                    self._texture("emission", raw.get("emissiveTexture"), True, [*glow, 1.0]), "rgb")  # fmt: skip
        shade = self._texture("occlusion", raw.get("occlusionTexture"), False, [1.0] * 4)
        if shade is not None:
            self._input("occlusion", "Float", 1.0, shade, "r")
        bumps = self._texture("normals", raw.get("normalTexture"), False, [2.0, 2.0, 2.0, 1.0], [-1.0, -1.0, -1.0, 0.0])
        if bumps is not None:
            self._input("normal", "Normal3f", [0.0, 0.0, 1.0], bumps, "rgb")

    def _input(self, name: str, kind: str, value: Any, texture: Any = None, output: str = "") -> None:
        """An input, from a texture's output where there is one."""
        from pxr import Gf, Sdf

        own = self.shader.CreateInput(name, getattr(Sdf.ValueTypeNames, kind))
        if texture is not None:
            wide = Sdf.ValueTypeNames.Float3 if output == "rgb" else Sdf.ValueTypeNames.Float
            own.ConnectToSource(texture.CreateOutput(output, wide))
        else:
            own.Set(Gf.Vec3f(*value) if isinstance(value, list) else float(value))

    def _texture(
        self, name: str, raw: dict[str, Any] | None, coloured: bool, scale: list[float], bias: list[float] | None = None
    ) -> Any:
        """The shader of a texture, which reads its own set of coordinates; None where there is no picture."""
        from pxr import Gf, Sdf, UsdShade

        file = self._file(raw)
        if raw is None or file is None:
            return None
        kinds, number = Sdf.ValueTypeNames, int(raw.get("texCoord", 0))
        reader = UsdShade.Shader.Define(self.stage, f"{self.path}/coordinates_{number}")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", kinds.String).Set(coordinates(number))
        texture = UsdShade.Shader.Define(self.stage, f"{self.path}/{name}")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", kinds.Asset).Set(Sdf.AssetPath(file))
        texture.CreateInput("st", kinds.Float2).ConnectToSource(reader.CreateOutput("result", kinds.Float2))
        texture.CreateInput("sourceColorSpace", kinds.Token).Set("sRGB" if coloured else "raw")
        texture.CreateInput("scale", kinds.Float4).Set(Gf.Vec4f(*scale))
        if bias is not None:
            texture.CreateInput("bias", kinds.Float4).Set(Gf.Vec4f(*bias))
        sampler = self.look.textures[raw["index"]].get("sampler")
        wraps = self.look.samplers[sampler] if sampler is not None else {}
        for axis in "ST":
            wrap = _WRAPS.get(wraps.get(f"wrap{axis}", 10497), "repeat")
            texture.CreateInput(f"wrap{axis}", kinds.Token).Set(wrap)
        return texture

    def _file(self, raw: dict[str, Any] | None) -> str | None:
        if raw is None:
            return None
        texture = self.look.textures[raw["index"]]
        for named in (texture, *(texture.get("extensions") or {}).values()):
            if isinstance(named, dict) and "source" in named:
                return self.files[int(named["source"])]
        return None


def coordinates(number: int) -> str:
    """The name in USD of a set of texture coordinates."""
    return "st" if number == 0 else f"st{number}"
