#![no_main]

cloudparity_fuzz::target!("study", Toml);
