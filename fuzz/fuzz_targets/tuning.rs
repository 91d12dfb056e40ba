#![no_main]

cloudparity_fuzz::target!("tuning", Toml);
