//! The textures of programs as one buffer.

use super::Gpu;
use crate::base::error::{Error, Result};
use crate::base::texture::{self, TextureHandle};

impl Gpu {
    /// Binding 0 of group 1 of kernels that read programs: the texels of their textures one behind the other, in the order in which a
    /// linker gives them. None where there is no texture.
    pub fn upload_textures(&self, textures: &[TextureHandle]) -> Result<Option<wgpu::Buffer>> {
        if textures.is_empty() {
            return Ok(None);
        }
        let bytes: u64 = textures.iter().map(|texture| 4 * texture.texels().word_count() as u64).sum();
        let most = self.device().limits().max_storage_buffer_binding_size;
        if bytes > most {
            return Err(Error::new(
                "textures of the density",
                format!("{bytes} bytes"),
                format!("at most {most} bytes, the largest buffer that adapter {} binds", self.adapter().name),
                "Lower the cells of the density cache or the texels of the model, or use the CPU.",
            ));
        }
        Ok(Some(self.upload("textures", &texture::words_of(textures), wgpu::BufferUsages::STORAGE)))
    }
}
